// A sheet of what several seeds make, to choose from.
import { html, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import type { Drawable } from "./picture-view";
import "./picture-view";

const SEEDS = 9;

export interface Sheet {
  pictures: (Drawable | null)[];
  first: number;
  /** the one that is being made */
  waiting: number;
}

export const newSheet = (first: number): Sheet => ({ pictures: Array<Drawable | null>(SEEDS).fill(null), first, waiting: 0 });

/** The sheet with a picture of the seed that is being made; if it is final, the next one is. */
export function withSeed({ pictures, first, waiting }: Sheet, picture: Drawable, isFinal: boolean): Sheet {
  const more = isFinal && waiting + 1 < SEEDS ? 1 : 0;
  return { pictures: pictures.map((one, index) => (index === waiting ? picture : one)), first, waiting: waiting + more };
}

/** Tells `seed` with the one that is taken. */
@customElement("seed-sheet")
export class SeedSheet extends Element {
  @property({ attribute: false }) sheet!: Sheet;

  override render(): TemplateResult {
    const { pictures, first } = this.sheet;
    return html`<div class="sheet">
      ${pictures.map((picture, index) => html`<button title="Take seed ${first + index}" @click=${() => this.tell("seed", first + index)}>
        <picture-view .picture=${picture} inert label="Seed ${first + index}"></picture-view>
        <span>Seed ${first + index}</span>
      </button>`)}
    </div>`;
  }
}
