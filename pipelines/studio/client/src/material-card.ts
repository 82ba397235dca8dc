// A material on the wall.
import { html, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import type { WallEntry } from "./messages";
import { title } from "./recipe-form";
import { pictureAddress, thumbnailAddress } from "./server";

const SIDE = 192; // px

/** Tells `open` with its id, `choose`, and `favourite`. */
@customElement("material-card")
export class MaterialCard extends Element {
  @property({ attribute: false }) entry!: WallEntry;
  @property({ type: Boolean }) chosen = false;

  override render(): TemplateResult {
    const { id, name, is_favourite, is_running, results, flow } = this.entry;
    const about = is_running ? "running" : results ? `${results} result${results === 1 ? "" : "s"}` : "not made yet";
    return html`
      <button class="cover" title="Open ${name}" aria-label="Open ${name}" @click=${() => this.tell("open", id)}>${coverOf(this.entry)}</button>
      <p class="row"><span class="name" title=${name}>${name}</span>
        <button class="quiet end" aria-pressed=${is_favourite} aria-label="Favourite: ${name}" title="Favourite"
          @click=${() => this.tell("favourite", null)}>${is_favourite ? "★" : "☆"}</button>
        <button class="quiet" aria-pressed=${this.chosen} aria-label="Details of ${name}" title="Name, tags, files, delete"
          @click=${() => this.tell("choose", null)}>⋯</button></p>
      <p class="hint">${flow ? `${title(flow)}, ` : ""}${about}</p>`;
  }
}

/** What a material looks like: its result, or the picture it begins with. */
export function coverOf({ cover, picture }: WallEntry): TemplateResult {
  const address = cover ? thumbnailAddress(cover) : picture ? pictureAddress(picture, SIDE) : "";
  if (!address) return html`<span class="blank"></span>`;
  return html`<img class=${cover ? "" : "exemplar"} src=${address} alt="" loading="lazy" draggable="false"
    @error=${(event: Event) => (event.target as HTMLElement).classList.add("lost")} />`;
}
