// A collage of pieces of the exemplar, which becomes a coherent texture.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import { DirectMode } from "./direct-mode";
import { document, type Draft } from "./drafts";
import { choice, slider } from "./fields";
import type { Drawing, Piece } from "./messages";
import { boxOf, contains, drawPiece, fileOf, handles } from "./pieces";
import type { Act, Over, Point } from "./picture-view";
import { Undo } from "./undo";

const PICKS = { box: "Rectangle", lasso: "Lasso" } as const;
const SHOWS = { pieces: "Pieces", result: "Result" } as const;
const REACH = 26; // screen pixels of the handle that turns a piece from it
const NEAR = 14; // screen pixels about a handle
const LEAST = 8; // px of a side of a piece
const [SMALLEST, LARGEST] = [0.1, 10]; // scale

@customElement("direct-collage")
export class DirectCollage extends DirectMode {
  protected readonly layer = "collage";
  protected readonly flow = "rectify_pieces";
  @state() protected history = new Undo<Piece[]>([]);
  @state() private chosen = -1;
  @state() private pick: keyof typeof PICKS = "box";
  @state() private shows: keyof typeof SHOWS = "pieces";
  @state() private strength = 70;
  /** while something is dragged */
  private moving: Piece[] | null = null;
  private drag: "move" | "turn" | "scale" | null = null;
  private from: Point = { x: 0, y: 0 };
  private outline: Point[] = [];

  protected reset(): void {
    [this.history, this.chosen, this.moving, this.outline] = [new Undo<Piece[]>([]), -1, null, []];
  }

  protected drawing(): Partial<Drawing> {
    return { collage: { pieces: this.history.now, strength: this.strength } };
  }

  protected override restore({ collage }: Drawing): void {
    if (collage) [this.history, this.strength] = [new Undo(collage.pieces), collage.strength];
  }

  private get pieces(): Piece[] {
    return this.moving ?? this.history.now;
  }

  private set(pieces: Piece[]): void {
    this.moving = null;
    this.history.set(pieces);
    this.chosen = Math.min(this.chosen, pieces.length - 1);
    this.changed();
    this.redraw();
  }

  private replaced(change: Partial<Piece>): Piece[] {
    return this.history.now.map((piece, index) => (index === this.chosen ? { ...piece, ...change } : piece));
  }

  protected stepBy(direction: "undo" | "redo"): void {
    this.history[direction]();
    this.chosen = Math.min(this.chosen, this.pieces.length - 1);
    this.changed();
    this.redraw();
  }

  protected override onKey(key: string): boolean {
    const piece = this.pieces[this.chosen];
    if (!piece) return false;
    if (key === "Delete" || key === "Backspace") this.discard();
    else if (key === "[" || key === "]") this.set(this.replaced({ angle: turned(piece.angle + (key === "[" ? 5 : -5)) }));
    else return false;
    return true;
  }

  // -- picking pieces of the exemplar

  private pickAct({ phase, x, y }: Act): void {
    const at = { x: clip(x, this.picture.width), y: clip(y, this.picture.height) };
    if (phase === "begin") [this.from, this.outline] = [at, [at]];
    else if (phase === "drag" && this.outline.length) {
      if (this.pick === "lasso") this.outline.push(at);
      else this.outline = corners(this.from, at);
    } else if (phase === "end" && this.outline.length) this.add(simplified(this.outline));
    if (phase === "end" || phase === "cancel") this.outline = [];
    this.redraw();
  }

  private add(outline: Point[]): void {
    const { left, top, right, bottom } = boxOf(outline);
    if (outline.length < 3 || right - left < LEAST || bottom - top < LEAST) {
      this.refuse("Drag over a larger part of the exemplar");
      return;
    }
    const step = (Math.min(...this.size) / 16) * (this.pieces.length % 8);
    this.chosen = this.pieces.length;
    this.shows = "pieces";
    this.set([...this.history.now, { outline, at: { x: this.size[1] / 2 + step, y: this.size[0] / 2 + step }, angle: 0, scale: 1 }]);
  }

  // -- laying them

  private layAct({ phase, x, y, scale }: Act): void {
    const at = { x, y };
    if (phase === "begin") this.beginDrag(at, scale);
    else if (phase === "drag" && this.drag) this.moving = this.replaced(this.dragged(at));
    else if (phase === "end") {
      const { moving } = this;
      this.drag = null;
      if (moving) this.set(moving);
    } else if (phase === "cancel") [this.drag, this.moving] = [null, null];
    this.redraw();
  }

  private beginDrag(at: Point, scale: number): void {
    this.from = at;
    this.shows = "pieces";
    const piece = this.pieces[this.chosen];
    if (piece) {
      const { turn, scale: corner } = handles(piece, REACH / scale);
      const near = (point: Point): boolean => Math.hypot(point.x - at.x, point.y - at.y) * scale < NEAR;
      this.drag = near(turn) ? "turn" : near(corner) ? "scale" : null;
      if (this.drag) return;
    }
    const under = this.pieces.map((one, index) => (contains(one, at) ? index : -1)).filter((index) => index >= 0);
    this.chosen = under.length ? under[under.length - 1] : -1;
    this.drag = under.length ? "move" : null;
  }

  private dragged(at: Point): Partial<Piece> {
    const piece = this.history.now[this.chosen];
    const angle = (point: Point): number => (-Math.atan2(point.y - piece.at.y, point.x - piece.at.x) * 180) / Math.PI;
    const away = (point: Point): number => Math.hypot(point.x - piece.at.x, point.y - piece.at.y);
    if (this.drag === "move") return { at: { x: Math.round(piece.at.x + at.x - this.from.x), y: Math.round(piece.at.y + at.y - this.from.y) } };
    if (this.drag === "turn") return { angle: turned(Math.round(piece.angle + angle(at) - angle(this.from))) };
    const ratio = (piece.scale * away(at)) / Math.max(1, away(this.from));
    return { scale: Math.round(100 * Math.min(LARGEST, Math.max(SMALLEST, ratio))) / 100 };
  }

  private discard(): void {
    this.set(this.history.now.filter((_, index) => index !== this.chosen));
  }

  /** Move the chosen piece in the order in which pieces lie on each other. */
  private reorder(by: number): void {
    const pieces = [...this.history.now];
    const to = Math.min(pieces.length - 1, Math.max(0, this.chosen + by));
    const [piece] = pieces.splice(this.chosen, 1);
    pieces.splice(to, 0, piece);
    this.chosen = to;
    this.set(pieces);
  }

  // -- what it makes

  protected async draft(): Promise<Draft | string> {
    if (!this.history.now.length) return "Drag over a part of the exemplar, on the left, to lay it into the result";
    const recipe = { ...this.base(this.flow, {}, { strength: this.strength / 100 }), files: { pieces: "attached:pieces.json" } };
    return { recipe, attached: { "pieces.json": document(fileOf(this.history.now)) } };
  }

  protected hint(): string {
    return "Drag over a part of the exemplar to lay it into the result";
  }

  // -- how it looks

  private readonly overExemplar: Over = (context, at) => {
    if (this.outline.length > 1) stroke(context, this.outline.map(at));
  };

  private readonly overResult: Over = (context, at, scale) => {
    const [left, top] = at({ x: 0, y: 0 });
    if (this.exemplar && this.shows === "pieces") {
      context.save();
      context.beginPath();
      context.rect(left, top, this.size[1] * scale, this.size[0] * scale);
      context.clip();
      context.translate(left, top);
      context.scale(scale, scale);
      for (const piece of this.pieces) drawPiece(context, piece, this.exemplar, [this.picture.height, this.picture.width]);
      context.restore();
    }
    const piece = this.pieces[this.chosen];
    if (!piece) return;
    const { outline, turn, scale: corner } = handles(piece, REACH / scale);
    stroke(context, outline.map(at));
    for (const [point, isRound] of [[turn, true], [corner, false]] as const) {
      const [x, y] = at(point);
      context.beginPath();
      if (isRound) context.arc(x, y, 6, 0, 2 * Math.PI);
      else context.rect(x - 5, y - 5, 10, 10);
      [context.fillStyle, context.strokeStyle, context.lineWidth] = ["#fff", "rgb(0 0 0 / 0.7)", 1.5];
      context.fill();
      context.stroke();
    }
  };

  protected panes(): TemplateResult {
    return html`
      <figure><figcaption>Exemplar: drag over a part to pick it</figcaption>
        <picture-view class="tool" tool="act" label="Exemplar" .picture=${this.exemplar} .tiles=${this.exemplarTiles} .extent=${[this.picture.height, this.picture.width]}
          .over=${this.overExemplar} @act=${(event: CustomEvent<Act>) => this.pickAct(event.detail)}></picture-view></figure>
      <figure><figcaption class="row">Result ${choice("What is shown", SHOWS, this.shows, (shows) => {
        this.shows = shows;
        this.redraw();
      })}</figcaption>
        <picture-view tool="act" label="Result: drag pieces and their handles" .picture=${this.shows === "result" ? this.shown : null} .extent=${this.size}
          .over=${this.overResult} @act=${(event: CustomEvent<Act>) => this.layAct(event.detail)}></picture-view></figure>`;
  }

  protected tools(): TemplateResult {
    const pieces = this.history.now;
    return html`
      ${choice("Pick by", PICKS, this.pick, (pick) => (this.pick = pick))}
      ${pieces.length ? html`<div class="chips" role="radiogroup" aria-label="Pieces, the last one on top">${pieces.map((_, index) => html`<button
        role="radio" aria-checked=${index === this.chosen} aria-label="Piece ${index + 1}" @click=${() => {
          this.chosen = index;
          this.redraw();
        }}>${index + 1}</button>`)}</div>` : html`<p class="hint">Pieces may overlap and be turned and scaled; what lies between them is synthesised.</p>`}
      ${pieces[this.chosen] ? this.pieceTools(pieces[this.chosen]) : nothing}
      ${slider("Strength, %", this.strength, 100, (value) => {
        this.strength = value;
        if (pieces.length) this.changed();
      })}
      <p class="hint">100 keeps the collage but for its joints, 0 only its coarse colours and structure.</p>
    `;
  }

  private pieceTools(piece: Piece): TemplateResult {
    const field = (label: string, value: number, set: (value: number) => Partial<Piece>): TemplateResult => html`<label class="field"><span>${label}</span>
      <input type="number" step="any" aria-label=${label} .value=${String(Math.round(100 * value) / 100)} @change=${(event: Event) => {
        const given = Number((event.target as HTMLInputElement).value);
        if (Number.isFinite(given)) this.set(this.replaced(set(given)));
      }} /></label>`;
    return html`
      <div class="pairs">
        ${field("Row", piece.at.y, (y) => ({ at: { ...piece.at, y } }))}
        ${field("Column", piece.at.x, (x) => ({ at: { ...piece.at, x } }))}
        ${field("Angle", piece.angle, (angle) => ({ angle: turned(angle) }))}
        ${field("Scale", piece.scale, (scale) => ({ scale: Math.min(LARGEST, Math.max(SMALLEST, scale)) }))}
      </div>
      <p class="row"><button class="half" ?disabled=${this.chosen === this.history.now.length - 1} @click=${() => this.reorder(1)}>Forward</button>
        <button class="half" ?disabled=${this.chosen === 0} @click=${() => this.reorder(-1)}>Back</button>
        <button class="half" @click=${() => this.discard()}>Delete</button></p>`;
  }
}

const clip = (value: number, most: number): number => Math.min(most, Math.max(0, value));
const corners = (one: Point, other: Point): Point[] => [one, { x: other.x, y: one.y }, other, { x: one.x, y: other.y }];
/** Within -180 to 180. */
const turned = (angle: number): number => angle - 360 * Math.round(angle / 360);

/** Without points that lie close to the one before. */
function simplified(outline: Point[]): Point[] {
  const rounded = outline.map(({ x, y }) => ({ x: Math.round(x), y: Math.round(y) }));
  return rounded.filter((one, index) => !index || Math.hypot(one.x - rounded[index - 1].x, one.y - rounded[index - 1].y) >= 2);
}

function stroke(context: CanvasRenderingContext2D, points: [number, number][]): void {
  for (const [style, width] of [["rgb(0 0 0 / 0.6)", 4], ["#fff", 1.6]] as const) {
    [context.strokeStyle, context.lineWidth] = [style, width];
    context.beginPath();
    points.forEach(([x, y]) => context.lineTo(x, y));
    context.closePath();
    context.stroke();
  }
}
