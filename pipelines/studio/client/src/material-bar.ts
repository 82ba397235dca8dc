// The material that is open: its name, whether it is a favourite, and its results to go back to.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import type { MaterialRequest, Variant } from "./messages";
import { thumbnailAddress } from "./server";
import { isOver, type Studio } from "./studio";
import { named } from "./variants";

@customElement("material-bar")
export class MaterialBar extends Element {
  @property({ attribute: false }) studio!: Studio;
  /** the name that is being typed, which news of the material leave alone */
  @state() private typed: string | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  override render(): TemplateResult {
    const { project } = this.studio;
    const { material } = project;
    const { problem } = project.state;
    return html`<div class="bar material">
      ${material
        ? html`<input type="text" aria-label="Name of the material" maxlength="64" .value=${this.typed ?? material.name}
              @input=${(event: Event) => (this.typed = (event.target as HTMLInputElement).value)}
              @blur=${() => (this.typed = null)}
              @change=${(event: Event) => this.rename(event.target as HTMLInputElement)} />
            <button class="quiet" aria-pressed=${material.is_favourite} aria-label="Favourite" title="Favourite"
              @click=${() => this.edit({ is_favourite: !material.is_favourite })}>${material.is_favourite ? "★" : "☆"}</button>`
        : html`<span class="hint">A new material, kept as soon as a picture is chosen</span>`}
      <span class="state ${problem ? "bad" : ""}" role="status">${problem || (material ? "Saved in the project" : "")}</span>
      <button ?disabled=${!material} @click=${() => project.close()}>New material</button>
    </div>`;
  }

  private rename(input: HTMLInputElement): void {
    const name = input.value.trim();
    this.typed = null;
    if (name) this.edit({ name });
    else input.value = this.studio.project.material?.name ?? "";
  }

  private edit(change: MaterialRequest): void {
    this.studio.project.edit(change);
    this.requestUpdate();
  }
}

/** Tells `result` with one to go back to, and `against` with one to compare what is shown with, or none. */
@customElement("material-results")
export class MaterialResults extends Element {
  @property({ attribute: false }) studio!: Studio;
  /** the run that is looked at */
  @property() shown = "";
  /** the run that it is compared with */
  @property() against = "";

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  override render(): TemplateResult | typeof nothing {
    const variants = this.studio.project.material?.variants ?? [];
    if (!variants.length) return nothing;
    const canCompare = this.studio.jobs.get(this.shown)?.state === "done";
    return html`<section class="results" aria-label="Results of this material">
      <ul>${[...variants].reverse().map((one) => this.result(one, canCompare))}</ul>
    </section>`;
  }

  private result(variant: Variant, canCompare: boolean): TemplateResult {
    const job = this.studio.jobs.get(variant.job.id) ?? variant.job;
    const isDone = job.state === "done";
    const words = named({ ...variant, job });
    const state = isDone ? "" : isOver(job) ? job.state : job.state === "running" ? `${Math.round(100 * job.done)} %` : "waits";
    return html`<li class=${job.id === this.against ? "against" : ""}>
      <button aria-pressed=${job.id === this.shown} title="${words}, ${new Date(1000 * variant.made).toLocaleString()}"
        aria-label="${words}: go back to it${state ? `, ${state}` : ""}" @click=${() => this.tell("result", variant)}>
        ${isDone ? html`<img src=${thumbnailAddress(job.id)} alt="" loading="lazy" draggable="false" />` : html`<span class="blank">${state}</span>`}
        <span>${words}</span></button>
      ${isDone && canCompare && job.id !== this.shown
        ? html`<button class="quiet" aria-pressed=${job.id === this.against} aria-label="Compare with: ${words}"
            title="Compare what is shown with this" @click=${() => this.tell("against", job.id === this.against ? "" : job.id)}>⇄</button>`
        : nothing}
    </li>`;
  }
}
