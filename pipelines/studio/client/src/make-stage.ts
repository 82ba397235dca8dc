// What has been made of a recipe: the preview or the result, in several ways to look at it.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import type { Comparison } from "./comparison";
import { Element } from "./element";
import { choice, isTyping, undoButtons } from "./fields";
import { mapAddress } from "./large-pictures";
import type { MadeResults } from "./made-results";
import { chosenSpace, keepSpace, MODES, type Shown, type Space, SPACES } from "./make-modes";
import "./material-view";
import type { Method, Recipe } from "./messages";
import type { Drawable, Mode, Patch, Point } from "./picture-view";
import "./picture-view";
import { meshOf, picturesOf } from "./recipe-edits";
import type { Maps } from "./scene";
import { sides } from "./sizes";
import "./source-inset";
import type { Studio } from "./studio";
import type { Tiles } from "./tiles";
import type { Sheet } from "./variants";
import "./variant-sheet";

const NONE: Point[] = [];

/** Tells `mode`, `step` with `undo` or `redo`, `file` with the export to show, what a sheet of variants tells, and `lasso` with an outline. */
@customElement("make-stage")
export class MakeStage extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) method!: Method;
  @property({ attribute: false }) results!: MadeResults;
  /** another object each time, as results change inside */
  @property({ attribute: false }) history = { canUndo: false, canRedo: false };
  @property({ attribute: false }) mode: Shown = "single";
  @property({ attribute: false }) modes: Partial<Record<Shown, string>> = MODES;
  /** the export that is shown of a result */
  @property({ attribute: false }) file = "";
  @property({ attribute: false }) sheet: Sheet | null = null;
  @property({ attribute: false }) preview: Drawable | null = null;
  @property({ attribute: false }) previewScale = 1;
  @property({ attribute: false }) exemplar: ImageBitmap | null = null;
  @property({ attribute: false }) exemplarTiles: Tiles | null = null;
  /** another result, which is shown in place of the exemplar; another object inside each time */
  @property({ attribute: false }) other!: Comparison;
  @property({ attribute: false }) done = 1;
  @property({ attribute: false }) status: string | TemplateResult = "";
  /** what is said where there is no picture yet */
  @property({ attribute: false }) waits = "";
  @property({ attribute: false }) isCorrecting = false;
  @property({ attribute: false }) outline: Point[] = NONE;
  @property({ attribute: false }) patch: Patch | null = null;
  @state() private marksPlaces = localStorage.getItem("worst places") === "marked";
  @state() private hovered: Point | null = null;
  @state() private chosen: Space | null = chosenSpace();
  private lit: { of: unknown; maps: Maps } = { of: null, maps: {} };

  protected override onWindowKey(event: KeyboardEvent): void {
    if (!this.checkVisibility() || isTyping(event) || event.ctrlKey || event.metaKey) return;
    if (event.key.toLowerCase() === "w") this.markPlaces();
  }

  private markPlaces(): void {
    this.marksPlaces = !this.marksPlaces;
    localStorage.setItem("worst places", this.marksPlaces ? "marked" : "");
  }

  override render(): TemplateResult {
    const { results } = this;
    const shown = results.picture ?? this.preview;
    return html`
      <div class="bar">
        ${choice("How to look at it", this.modes as Record<Shown, string>, this.mode, (mode) => this.tell("mode", mode))}
        ${undoButtons(this.history, (direction) => this.tell("step", direction))}
        ${this.views()}
        ${results.picture && results.places.length && this.mode === "single"
          ? html`<button class="quiet" title="Mark the places least like the exemplar (W)" aria-pressed=${this.marksPlaces} @click=${() => this.markPlaces()}>Worst places</button>`
          : nothing}
        <span class="state" role="status">${this.status}</span>
        ${this.sheet ? nothing : choice("Flat, lit, or both", SPACES, this.space, (space) => keepSpace((this.chosen = space)))}
      </div>
      ${this.sheet ? html`<variant-sheet .sheet=${this.sheet}></variant-sheet>` : html`<div class="spaces">
        ${this.space === "lit" ? nothing : shown || this.mode === "compare" ? this.view(shown) : this.begin()}
        ${this.space === "flat" ? nothing : html`<material-view .studio=${this.studio} .maps=${this.maps(shown)} .mesh=${meshOf(this.recipe)}
          .side=${this.recipe.size ? sides(this.recipe.size)[0] : 1024}></material-view>`}
      </div>`}
      ${shown || this.sheet || this.exemplar ? nothing : html`<p class="welcome over">${this.waits}</p>`}
      ${results.origins && results.picture && this.exemplar && this.hovered && !this.isCorrecting
        ? html`<source-inset .exemplar=${this.exemplar} .origins=${results.origins} .place=${this.hovered}
            .size=${results.size} .scale=${this.exemplarWidth / this.exemplar.width}></source-inset>`
        : nothing}
      ${this.done < 1 && !results.id ? html`<progress class="line" max="1" .value=${this.done} aria-label="Preview"></progress>` : nothing}
    `;
  }

  /** What it begins with, until there is something made of it. */
  private begin(): TemplateResult {
    return html`<picture-view label="Picture" .picture=${this.exemplar} .tiles=${this.exemplarTiles}></picture-view>`;
  }

  private view(shown: Drawable | null): TemplateResult {
    const { results, other } = this;
    const marked = (this.isCorrecting || this.marksPlaces) && results.picture && !this.outline.length ? results.places : [];
    return html`<picture-view
      .picture=${shown}
      .tiles=${results.tiles}
      .exemplar=${other.picture ?? this.exemplar}
      .exemplarTiles=${other.picture ? other.tiles : this.exemplarTiles}
      .exemplarScale=${other.picture && shown ? this.width(shown) / other.picture.width : this.exemplarScale(shown)}
      .mode=${this.mode as Mode}
      .isReduced=${results.picture ? !results.isWhole : this.previewScale < 1}
      .tool=${this.isCorrecting ? "lasso" : "pan"}
      .outline=${this.outline}
      .patch=${this.patch}
      .marks=${marked.length ? marked.map(({ row, column }) => ({ x: column, y: row })) : NONE}
      @hover=${(event: CustomEvent<Point | null>) => (this.hovered = event.detail)}
      label=${results.picture ? "Texture at full size" : "Preview"}
    ></picture-view>`;
  }

  /** Where one looks: a material is shown lit beside it, unless something else was chosen. */
  private get space(): Space {
    return this.isCorrecting ? "flat" : this.chosen ?? (this.hasMaps ? "both" : "flat");
  }

  private get hasMaps(): boolean {
    return Object.keys(this.results.job?.maps ?? {}).length > 1;
  }

  /** The maps of a result, or the colour of what is there so far; the same object for the same, so that it is loaded once. */
  private maps(shown: Drawable | null): Maps {
    const { job, isWhole } = this.results;
    const of = isWhole ? job?.id : shown;
    if (this.lit.of !== of) {
      const files = isWhole && job ? Object.entries(job.maps) : [];
      const maps = Object.fromEntries(files.map(([role, file]) => [role, mapAddress(job!, file)]));
      this.lit = { of, maps: isWhole ? maps : shown ? { albedo: shown } : {} };
    }
    return this.lit.maps;
  }

  /** What of a result is shown, where it has several pictures. */
  private views(): TemplateResult | typeof nothing {
    const files = this.results.job?.files ?? [];
    const views = this.method.views.filter((one) => files.includes(one.file));
    if (views.length < 2 || this.isCorrecting || this.sheet) return nothing;
    return choice("What to show", Object.fromEntries(views.map((one) => [one.file, one.name])), this.file, (file) => this.tell("file", file));
  }

  private get exemplarWidth(): number {
    return this.studio.picture(picturesOf(this.recipe)[0])?.width ?? 1;
  }

  /** Of what is shown, px. */
  private width(shown: Drawable): number {
    return this.results.tiles?.width ?? shown.width;
  }

  /** How large the pixels of the exemplar that is loaded are, in those of what is shown. */
  private exemplarScale(shown: Drawable | null): number {
    const perPixel = this.exemplarWidth / (this.exemplar?.width ?? this.exemplarWidth);
    const size = this.recipe.size ?? this.method.size;
    if (!this.results.picture || !shown || !size) return perPixel * this.previewScale;
    return (perPixel * this.width(shown)) / sides(size)[1];
  }
}
