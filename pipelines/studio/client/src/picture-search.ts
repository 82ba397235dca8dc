// Which of the pictures of a folder are listed.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import type { PicturePage } from "./messages";

const FEW = 12; // pictures that need no search
const DROPPED = ":dropped";

export type Asked = { search: string; folder: string; sorting: "name" | "newest" };

/** Tells `search` with what is asked for. */
@customElement("picture-search")
export class PictureSearch extends Element {
  @property({ attribute: false }) page!: PicturePage;
  @property({ attribute: false }) asked!: Asked;

  override render(): TemplateResult | typeof nothing {
    const { page, asked } = this;
    const folders = Object.entries(page.folders);
    if (page.total <= FEW && !folders.some(([folder]) => folder !== DROPPED)) return nothing;
    return html`<div class="search">
      <input type="text" aria-label="Search pictures" placeholder="Search ${page.total} pictures" .value=${asked.search}
        @input=${(event: Event) => this.ask({ search: value(event) })} />
      ${folders.length
        ? html`<select aria-label="Folder" @change=${(event: Event) => this.ask({ folder: value(event) })}>
            <option value="" ?selected=${!asked.folder}>All folders</option>
            ${folders.map(([folder, count]) => html`<option value=${folder} ?selected=${folder === asked.folder}>${folder === DROPPED ? "Dropped" : folder} (${count})</option>`)}
          </select>`
        : nothing}
      <select aria-label="Pictures sorted by" @change=${(event: Event) => this.ask({ sorting: value(event) as Asked["sorting"] })}>
        <option value="name" ?selected=${asked.sorting === "name"}>By name</option>
        <option value="newest" ?selected=${asked.sorting === "newest"}>Newest first</option>
      </select>
      <p class="hint" role="status">${Math.min(page.asked, page.found)} of ${page.found}${page.found < page.total ? ` found in ${page.total}` : ""} shown</p>
    </div>`;
  }

  private ask(change: Partial<Asked>): void {
    this.tell("search", { ...this.asked, ...change });
  }
}

const value = (event: Event): string => (event.target as HTMLInputElement).value;
