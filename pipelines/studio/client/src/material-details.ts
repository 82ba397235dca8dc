// The details of a material that is chosen on the wall.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import "./job-panel";
import { coverOf } from "./material-card";
import type { Job, WallEntry } from "./messages";
import { openMaterial } from "./server";
import type { Studio } from "./studio";

/** Tells `edit` with what changes, `duplicate`, `discard`, `restore`, and `open` with its id. */
@customElement("material-details")
export class MaterialDetails extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) entry!: WallEntry;
  @state() private job: Job | null = null;
  private asked = "";

  protected override willUpdate(): void {
    const { id, cover } = this.entry;
    if (this.asked === `${id} ${cover}`) return;
    this.asked = `${id} ${cover}`;
    this.job = null;
    if (cover) void this.load(id, cover);
  }

  /** The run that has made what is shown. */
  private async load(id: string, cover: string): Promise<void> {
    const found = await this.studio.attempt(openMaterial(id));
    if (!found || this.entry.cover !== cover) return;
    this.studio.knowRuns(found.material.variants);
    this.job = this.studio.jobs.get(cover) ?? null;
  }

  override render(): TemplateResult {
    const { entry } = this;
    return html`
      <div class="cover">${coverOf(entry)}</div>
      ${entry.is_deleted
        ? html`<p><strong>${entry.name}</strong></p><p class="hint">It is in the bin.</p>
            <button class="primary" @click=${() => this.tell("restore", null)}>Restore</button>`
        : this.settings()}
      ${this.job && !entry.is_deleted ? html`<job-panel .studio=${this.studio} .job=${this.job}></job-panel>` : nothing}
    `;
  }

  private settings(): TemplateResult {
    const { entry } = this;
    return html`
      <button class="primary" @click=${() => this.tell("open", entry.id)}>Open</button>
      <label class="field"><span>Name</span>
        <input type="text" aria-label="Name" maxlength="64" .value=${entry.name} @change=${(event: Event) => this.rename(event)} /></label>
      <label class="field"><span>Tags</span>
        <input type="text" aria-label="Tags, with commas between them" placeholder="brick, wet" .value=${entry.tags.join(", ")}
          @change=${(event: Event) => this.tell("edit", { tags: tagsIn((event.target as HTMLInputElement).value) })} /></label>
      <p class="row"><button class="half" @click=${() => this.tell("duplicate", null)}>Duplicate</button>
        <button class="half" @click=${() => this.tell("discard", null)}>Delete</button></p>`;
  }

  private rename(event: Event): void {
    const input = event.target as HTMLInputElement;
    if (input.value.trim()) this.tell("edit", { name: input.value });
    input.value = this.entry.name; // until it is known that it may have that name
  }
}

const tagsIn = (text: string): string[] =>
  [...new Set(text.split(",").map((one) => one.trim().slice(0, 32)).filter(Boolean))].slice(0, 16);
