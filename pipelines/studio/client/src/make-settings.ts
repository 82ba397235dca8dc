// The steps of a material in their order, as cards: what it begins with, light, region, maps, making, correcting, export.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import { card, choice, isTyping } from "./fields";
import "./job-panel";
import { drawnOn, type LayerName, LAYERS } from "./layers";
import type { Control, Job, Method, Picture, Recipe } from "./messages";
import "./method-controls";
import { toldOf } from "./method-controls";
import { picturesOf, SEED } from "./recipe-edits";
import "./recipe-form";
import type { Studio } from "./studio";

const COLOUR = "self_tuning"; // where maps are wanted no more
const ABOUT = "Areas and lines that guide it, pieces of the picture, the lattice of tiles, a map such as wetness, or lines on a mesh.";
type Begins = Method["begins"];
const BEGINNINGS: Record<Begins, string> = { picture: "A flat picture", photograph: "A photograph", maps: "Maps" };
const HINTS: Record<Begins, string> = {
  picture: "The picture shows the surface alone, from the front.",
  photograph: "The surface is somewhere in the picture, maybe at an angle.",
  maps: "All maps of the folder are made together.",
};

/**
 * Tells `edit` with the fields of a recipe that change, `finish`, `correct`, `layer` with where to draw, `undraw` to go on
 * without what is drawn, and `inspect` with what to look at.
 */
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
    const { job, method } = this;
    return html`
      ${method.several ? nothing : this.beginning()}
      ${this.step("light", "Light")}
      ${this.step("region", "Region")}
      ${method.several || !this.canHaveMaps ? nothing : this.maps()}
      ${method.several || !this.picture ? nothing : this.drawing()}
      ${card("Make", "", true, this.making())}
      ${job?.state === "done" && method.can_correct
        ? card("Correct", "", true, html`<button ?disabled=${!this.isWhole} @click=${() => this.tell("correct", null)}>Correct a spot</button>`)
        : nothing}
      ${job ? html`<job-panel .studio=${this.studio} .job=${job}></job-panel>` : nothing}
      ${job?.state === "done" ? html`<button @click=${() => this.tell("inspect", `job:${job.id}`)}>Inspect it</button>` : nothing}
      <button ?disabled=${this.lacking !== ""} @click=${() => this.studio.show(job?.recipe ?? this.recipe)}>Show as YAML or command</button>
    `;
  }

  /** What it begins with, if that is there. */
  private get picture(): Picture | undefined {
    return this.studio.picture(picturesOf(this.recipe)[0]);
  }

  /** Whether the picture is a set of maps. */
  private get isMaterial(): boolean {
    return this.picture?.is_material ?? false;
  }

  /** Whether maps can be estimated of the picture in place of what is made now. */
  private get canHaveMaps(): boolean {
    return !this.isMaterial && this.method.is_texture && !this.method.layer;
  }

  private beginning(): TemplateResult | typeof nothing {
    const { begins } = this.method;
    const title = this.isMaterial ? "Maps" : begins === "photograph" ? "Photograph" : "Picture";
    const { picture, photograph } = BEGINNINGS;
    const choose = (one: Begins): void => this.edit({ flow: this.studio.begin.methods.find((method) => method.begins === one && !method.layer)!.flow });
    return card(title, "", true, html`
      ${this.isMaterial || !this.method.is_texture ? nothing : choice("What it is", { picture, photograph }, begins as "picture" | "photograph", choose)}
      <p class="hint">${HINTS[this.isMaterial ? "maps" : begins]}</p>
      ${begins === "photograph" && this.picture
        ? html`<button title="Planes and curved surfaces, holes, and other photographs" @click=${() => this.tell("layer", "surfaces")}>Place surfaces by hand</button>`
        : nothing}
      ${this.picture?.id.toLowerCase().endsWith(".exr") ? html`<button @click=${() => this.tell("inspect", this.picture!.id)}>Inspect it</button>` : nothing}`);
  }

  /** What is drawn on it. */
  private drawing(): TemplateResult {
    const drawn = drawnOn(this.recipe, this.method);
    return card("Draw", drawn || "guides, collage, paint, mesh", drawn !== "", html`
      <div class="layers">${choice<LayerName>("Layer", LAYERS as Record<LayerName, string>, "result", (one) => one !== "result" && this.tell("layer", one))}</div>
      ${drawn ? html`<button @click=${() => this.tell("undraw", null)}>Without ${drawn}</button>` : html`<p class="hint">${ABOUT}</p>`}`);
  }

  private step(name: Control["card"], title: string): TemplateResult | typeof nothing {
    const told = toldOf(this.recipe, this.method, name);
    return told === null ? nothing : card(title, told, false, this.controls(name));
  }

  private controls(name: Control["card"]): TemplateResult {
    return html`<method-controls .recipe=${this.recipe} .method=${this.method} .card=${name}></method-controls>`;
  }

  private maps(): TemplateResult {
    const { method } = this;
    const flow = this.studio.begin.methods.find((one) => one.begins === "picture" && one.has_maps)!.flow;
    const kinds = { colour: "Colour only", all: "All maps" } as const;
    return card("Maps", "", true, html`
      ${method.begins === "photograph"
        ? nothing
        : choice("What is made", kinds, method.has_maps ? "all" : "colour", (one) => this.edit({ flow: one === "all" ? flow : COLOUR }))}
      ${method.has_maps ? html`<p class="hint">${method.about}.</p>${this.controls("maps")}` : nothing}`);
  }

  private making(): TemplateResult {
    const { job, method } = this;
    const isBusy = job?.state === "waiting" || job?.state === "running";
    const methods = method.layer || (method.has_maps && !this.isMaterial) ? [] : this.studio.begin.methods.filter((one) => this.fits(one));
    return html`
      <recipe-form .studio=${this.studio} .recipe=${this.recipe} .method=${method} .methods=${methods} .pictures=${this.pictures}></recipe-form>
      <button class="primary" ?disabled=${isBusy || this.lacking !== ""} @click=${() => this.tell("finish", null)}>Finish at full size</button>`;
  }

  /** Whether a method can be chosen by its name; others are by what the surface is in and by its maps. */
  private fits(method: Method): boolean {
    return method.begins === "maps" ? this.isMaterial : method.begins === "picture" && !method.has_maps && !method.layer;
  }

  private edit(change: Partial<Recipe>): void {
    if (change.flow !== this.recipe.flow) this.tell("edit", change);
  }
}
