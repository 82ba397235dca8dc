// Correcting a result: draw around a bad spot, choose among other versions of it, accept one.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import { choice } from "./fields";
import type { AlternativePicture, BadPlace, Job, Recipe, ToPage } from "./messages";
import type { Drawable, Patch, Point } from "./picture-view";
import { PAINTED, upload } from "./server";
import { canvasOf, type Payload, type Studio } from "./studio";

const SEEDS = 4; // versions at a time
const ROUND = 24; // points of a circle
const PARTS = { inside: "The inside", outside: "All else" } as const;
type Part = keyof typeof PARTS;
const HINTS: Record<Part, string> = {
  inside: "Draw around a bad spot in the picture: only its inside is synthesised again, everything else stays as it is.",
  outside: "Draw around what is good in the picture: it stays as it is, and all else is synthesised again.",
};

interface Alternative {
  picture: Drawable;
  place: AlternativePicture;
}

/** Tells `outline` and `patch`, what the picture is to show, and `accept` with the recipe of the version taken. */
@customElement("correct-panel")
export class CorrectPanel extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) job!: Job;
  @property({ attribute: false }) places: BadPlace[] = [];
  /** height and width of the result, px */
  @property({ attribute: false }) size: [number, number] = [1, 1];
  @state() private found: Alternative[] = [];
  @state() private chosen: Alternative | null = null;
  @state() private wanted = 0;
  /** what is made again */
  @state() private again: Part = "inside";
  @state() private problem = "";
  private recipe: Recipe | null = null;
  private number = -1;
  private stop: (() => void) | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.stop = this.studio.listen((message, payload) => this.receive(message, payload));
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.stop?.();
  }

  /** Synthesise the inside of an outline again, or all else. */
  async begin(outline: Point[]): Promise<void> {
    this.found = [];
    this.choose(null);
    this.problem = "";
    this.wanted = SEEDS;
    const region = await this.studio.attempt(painted(outline, this.size, this.again).then((file) => upload([file], "")));
    if (!region) {
      this.wanted = 0;
      return;
    }
    const { recipe } = this.job;
    const sources = { texture: this.job.texture, exemplar: this.job.exemplar || recipe.sources.exemplar, region: region.id };
    this.recipe = { flow: "revise", sources, tileable: recipe.tileable, seed: 1 };
    this.ask(1);
  }

  private ask(first: number): void {
    const seeds = Array.from({ length: SEEDS }, (_, index) => first + index);
    this.number = this.studio.alternatives(this.recipe!, seeds);
  }

  private more(): void {
    this.problem = "";
    this.wanted += SEEDS;
    this.ask(this.found.length + 1);
  }

  private receive(message: ToPage, payload: Payload): void {
    if (!("number" in message) || message.number !== this.number) return;
    if (message.kind === "alternative_picture") {
      const made = { picture: canvasOf(payload, message.width, message.height), place: message };
      this.found = [...this.found.filter(({ place }) => place.seed !== message.seed), made];
      if (!this.chosen) this.choose(made);
    } else if (message.kind === "preview_failed") {
      this.problem = message.problem;
      this.wanted = this.found.length;
    }
  }

  private choose(one: Alternative | null): void {
    this.chosen = one;
    const patch: Patch | null = one && { picture: one.picture, x: one.place.left, y: one.place.top };
    this.tell("patch", patch);
  }

  private accept(): void {
    if (this.again === "outside") this.tell("outline", cornersOf(this.size)); // no bad place of before is left
    this.tell("accept", { ...this.recipe!, seed: this.chosen!.place.seed });
  }

  private around({ row, column }: BadPlace): void {
    const radius = Math.max(16, Math.round(Math.max(...this.size) / 24));
    const outline = Array.from({ length: ROUND }, (_, index) => {
      const angle = (2 * Math.PI * index) / ROUND;
      return { x: Math.round(column + radius * Math.cos(angle)), y: Math.round(row + radius * Math.sin(angle)) };
    });
    this.tell("outline", outline);
    void this.begin(outline);
  }

  override render(): TemplateResult {
    const waits = this.found.length < this.wanted;
    return html`
      <h2>Correct a spot</h2>
      ${this.wanted ? nothing : choice("What is made again", PARTS, this.again, (part) => (this.again = part))}
      <p class="hint">${HINTS[this.again]} Alt-drag pans, the wheel zooms.</p>
      ${this.places.length && !this.wanted && this.again === "inside"
        ? html`<p>Places least like the exemplar:</p>
            <div class="chips" role="group" aria-label="Worst places">${this.places.map((place, index) => html`<button
              title="Row ${place.row}, column ${place.column}" @click=${() => this.around(place)}>${index + 1}</button>`)}</div>`
        : nothing}
      ${this.wanted
        ? html`<div class="versions" role="radiogroup" aria-label="Other versions">
              ${this.found.map((one) => html`<button role="radio" aria-checked=${one === this.chosen}
                aria-label="Version ${one.place.seed}" @click=${() => this.choose(one === this.chosen ? null : one)}>${one.picture}</button>`)}
            </div>
            <p class="hint" role="status">${this.problem || (waits ? `Making version ${this.found.length + 1} of ${this.wanted} …` : "Choose a version; click it again to see the spot as it was.")}</p>
            ${waits && !this.problem ? html`<progress max=${this.wanted} .value=${this.found.length} aria-label="Versions"></progress>` : nothing}
            <p class="row"><button class="primary" ?disabled=${!this.chosen} @click=${() => this.accept()}>Accept</button>
              <button ?disabled=${waits} @click=${() => this.more()}>${this.problem ? "Try again" : "More"}</button>
              <button @click=${() => this.tell("accept", null)}>Cancel</button></p>`
        : html`<p class="row"><button @click=${() => this.tell("accept", null)}>Done</button></p>`}
    `;
  }
}

const cornersOf = ([height, width]: [number, number]): Point[] =>
  [{ x: -1, y: -1 }, { x: width, y: -1 }, { x: width, y: height }, { x: -1, y: height }];

/** A picture of a region: white inside of an outline, or elsewhere; else black. */
async function painted(outline: Point[], [height, width]: [number, number], part: Part): Promise<File> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d")!;
  const colors = { inside: ["#000", "#fff"], outside: ["#fff", "#000"] }[part];
  context.fillStyle = colors[0];
  context.fillRect(0, 0, width, height);
  context.fillStyle = colors[1];
  context.beginPath();
  outline.forEach(({ x, y }) => context.lineTo(x + 0.5, y + 0.5));
  context.fill();
  const blob = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/png"));
  return new File([blob!], `${PAINTED}region.png`, { type: "image/png" });
}
