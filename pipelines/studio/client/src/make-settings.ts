// The settings of a texture, and what can be done with it.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import { isTyping } from "./fields";
import "./job-panel";
import type { Job, Method, Picture, Recipe } from "./messages";
import { picturesOf, SEED } from "./recipe-edits";
import "./recipe-form";
import type { Studio } from "./studio";

/** Tells `edit` with the fields of a recipe that change, `finish`, `correct`, and `inspect` with what to look at. */
@customElement("make-settings")
export class MakeSettings extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) method!: Method;
  /** the run whose result is shown */
  @property({ attribute: false }) job: Job | undefined;
  /** whether its finished picture is shown */
  @property({ attribute: false }) isWhole = false;
  /** what has still to be chosen */
  @property() lacking = "";

  protected override onWindowKey(event: KeyboardEvent): void {
    if (this.closest("[hidden]") || isTyping(event) || event.ctrlKey || event.metaKey) return;
    if (event.key.toLowerCase() === "n") this.tell("edit", { seed: (this.recipe.seed ?? SEED) + 1 });
  }

  private get pictures(): Picture[] {
    const { pictures, begin } = this.studio;
    return [...pictures, ...begin.examples.filter((one) => pictures.every(({ id }) => id !== one.id))];
  }

  override render(): TemplateResult {
    const { job, method, recipe } = this;
    const isBusy = job?.state === "waiting" || job?.state === "running";
    const isMaps = this.studio.picture(picturesOf(recipe)[0])?.is_material ?? false;
    const methods = this.studio.begin.methods.filter((one) => isMaps || one.flow !== "materials");
    return html`
      <recipe-form .studio=${this.studio} .recipe=${recipe} .method=${method} .methods=${methods} .pictures=${this.pictures}></recipe-form>
      <button class="primary" ?disabled=${isBusy || this.lacking !== ""} @click=${() => this.tell("finish", null)}>Finish at full size</button>
      ${job?.state === "done"
        ? html`<p class="row">
            ${method.can_correct ? html`<button class="half" ?disabled=${!this.isWhole} @click=${() => this.tell("correct", null)}>Correct a spot</button>` : nothing}
            <button class="half" @click=${() => this.tell("inspect", `job:${job.id}`)}>Look at it in 3D</button></p>`
        : nothing}
      ${job ? html`<job-panel .studio=${this.studio} .job=${job}></job-panel>` : nothing}
      <button ?disabled=${this.lacking !== ""} @click=${() => this.studio.show(job?.recipe ?? recipe)}>Show as YAML or command</button>
    `;
  }
}
