// A sheet of variants side by side, seen at one zoom, to choose from.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import { choice } from "./fields";
import { FITTED, type Look } from "./picture-view";
import "./picture-view";
import { type Cell, KINDS, type Sheet } from "./variants";

const BLENDED = 2; // results that one texture leads from and to
const NO_RESULTS = "Finish at full size makes the first result; results of this material are compared here.";

/** Tells `vary` with another kind, `take` with a cell, and `blend` with two results. */
@customElement("variant-sheet")
export class VariantSheet extends Element {
  @property({ attribute: false }) sheet!: Sheet;
  /** of all pictures */
  @state() private look: Look = FITTED;
  /** runs of the results that are to be blended */
  @state() private blended: readonly string[] = [];

  protected override willUpdate(changed: Map<string, unknown>): void {
    const before = changed.get("sheet") as Sheet | undefined;
    if (before && before.kind !== this.sheet.kind) [this.look, this.blended] = [FITTED, []];
  }

  override render(): TemplateResult {
    const { kind, cells } = this.sheet;
    const columns = Math.ceil(Math.sqrt(cells.length));
    const chosen = cells.filter(({ result }) => result && this.blended.includes(result.job.id));
    return html`<div class="bar">
        ${choice("What varies", KINDS, kind, (one) => this.tell("vary", one))}
        <span class="hint">All are moved and zoomed together.</span>
        ${kind === "results" && cells.length >= BLENDED
          ? html`<button ?disabled=${chosen.length !== BLENDED} title="Choose two results; a new material leads from one to the other"
              @click=${() => this.tell("blend", chosen.map(({ result }) => result!))}>Blend two</button>`
          : nothing}
      </div>
      ${cells.length ? nothing : html`<p class="welcome">${NO_RESULTS}</p>`}
      <div class="sheet" style="--columns: ${columns}" @look=${(event: CustomEvent<Look>) => (this.look = event.detail)}>
        ${cells.map((one) => this.cell(one))}
      </div>`;
  }

  private cell(cell: Cell): TemplateResult {
    const { label, result, picture, problem } = cell;
    return html`<figure aria-label=${label}>
      ${problem ? html`<p class="hint" title=${problem}>${inShort(problem)}</p>` : html`<picture-view .picture=${picture} .look=${this.look} .isReduced=${!result} label=${label}></picture-view>`}
      <figcaption>
        <button ?disabled=${problem !== ""} title="Go on with this one" @click=${() => this.tell("take", cell)}>${label}</button>
        ${result ? this.blendBox(result.job.id) : nothing}
      </figcaption>
    </figure>`;
  }

  private blendBox(job: string): TemplateResult {
    const isBlended = this.blended.includes(job);
    return html`<label><input type="checkbox" .checked=${isBlended} @change=${() => this.choose(job, isBlended)} /> blend</label>`;
  }

  /** Blend one, in place of the first where there are two; or no more. */
  private choose(job: string, isBlended: boolean): void {
    this.blended = isBlended ? this.blended.filter((one) => one !== job) : [...this.blended, job].slice(-BLENDED);
  }
}

/** The first sentence of a problem, without the step that it is of. */
const inShort = (problem: string): string => problem.split(". ")[0].replace(/^(\w+: )+/, "");
