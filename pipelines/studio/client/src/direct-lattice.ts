// The lattice of the exemplar, whose vectors and vertices are dragged while a straightened preview follows.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import { DirectMode } from "./direct-mode";
import { document, type Draft } from "./drafts";
import type { Drawing, LatticePicture, LatticeVertices, ToPage } from "./messages";
import type { Act, Drawable, Over, Point } from "./picture-view";
import { canvasOf, type Payload } from "./studio";
import { Undo } from "./undo";

const NEAR = 14; // screen pixels about a handle
const CELLS = 6; // along a side of the exemplar, of a lattice to begin with
type Vector = [number, number];

@customElement("direct-lattice")
export class DirectLattice extends DirectMode {
  protected readonly layer = "lattice";
  protected readonly flow = "near_regular";
  @state() protected history = new Undo<LatticeVertices | null>(null);
  @state() private straight: Drawable | null = null;
  @state() private view: "straight" | "result" = "straight";
  @state() private busy = "";
  private lines: LatticePicture | null = null;
  private moving: LatticeVertices | null = null;
  private drag: { vector: 0 | 1 } | { step: Vector } | "origin" | null = null;
  private request = -1;
  private waiting: LatticeVertices | null = null;
  private isWaiting = false;

  protected reset(): void {
    [this.history, this.straight, this.lines, this.moving, this.busy] = [new Undo<LatticeVertices | null>(null), null, null, null, ""];
    this.isWaiting = false;
    this.request = -1;
  }

  protected drawing(): Partial<Drawing> {
    return { lattice: this.history.now };
  }

  protected override restore({ lattice }: Drawing): void {
    if (!lattice) return;
    this.history = new Undo<LatticeVertices | null>(lattice);
    this.follow(lattice);
  }

  private get lattice(): LatticeVertices | null {
    return this.moving ?? this.history.now;
  }

  // -- the server's answers

  /** Have the server lay the lattice through what is placed; while it does, only the last change is remembered. */
  private follow(lattice: LatticeVertices | null): void {
    if (this.isWaiting) {
      this.waiting = lattice;
      return;
    }
    this.isWaiting = true;
    this.request = this.studio.next();
    this.studio.send({ kind: "lattice", number: this.request, picture: this.picture.id, lattice });
  }

  protected override onMessage(message: ToPage, payload: Payload): void {
    if (!("number" in message) || message.number !== this.request) return;
    if (message.kind === "preview_failed") {
      this.refuse(message.problem, () => this.follow(this.lattice));
    } else if (message.kind === "lattice_picture") {
      if (message.problem) this.refuse(message.problem);
      else {
        this.refuse("");
        this.lines = message;
        this.straight = canvasOf(payload, message.width, message.height);
      }
      if (this.busy && message.lattice) this.history.set(message.lattice);
    } else return;
    const wasBusy = this.busy;
    [this.isWaiting, this.busy] = [false, ""];
    if (this.waiting) {
      const next = this.waiting;
      this.waiting = null;
      this.follow(next);
    } else if (wasBusy) this.changed();
    this.redraw();
  }

  private detect(): void {
    this.busy = "Detecting the lattice …";
    this.follow(null);
  }

  /** Begin with two vectors along the borders. */
  private begin(): void {
    const [height, width] = [this.picture.height, this.picture.width];
    this.set({ vertices: [[0, 0, height / 2, width / 2]], generators: [[height / CELLS, 0], [0, width / CELLS]] });
  }

  private set(lattice: LatticeVertices): void {
    this.history.set(lattice);
    this.moving = null;
    this.follow(lattice);
    this.changed();
  }

  protected stepBy(direction: "undo" | "redo"): void {
    this.history[direction]();
    if (this.history.now) this.follow(this.history.now);
    else [this.lines, this.straight] = [null, null];
    this.changed();
    this.redraw();
  }

  // -- dragging

  /** The vertex from which vectors are drawn, and the ends of these. */
  private get frame(): [Point, Point, Point] | null {
    const { lattice } = this;
    if (!lattice?.generators) return null;
    const target = [this.picture.height / 2, this.picture.width / 2];
    const away = ([, , row, column]: number[]): number => Math.hypot(row - target[0], column - target[1]);
    const [, , row, column] = lattice.vertices.reduce((one, other) => (away(other) < away(one) ? other : one));
    const [first, second] = lattice.generators;
    return [
      { x: column + 0.5, y: row + 0.5 },
      { x: column + first[1] + 0.5, y: row + first[0] + 0.5 },
      { x: column + second[1] + 0.5, y: row + second[0] + 0.5 },
    ];
  }

  private act({ phase, x, y, scale, isOther }: Act): void {
    const at = { x, y };
    if (phase === "begin") this.beginDrag(at, scale, isOther);
    else if (phase === "drag" && this.drag) {
      this.moving = this.dragged(at);
      if (this.moving) this.follow(this.moving);
    } else if (phase === "end") {
      const { moving } = this;
      this.drag = null;
      if (moving) this.set(moving);
    } else if (phase === "cancel") {
      [this.drag, this.moving] = [null, null];
      if (this.history.now) this.follow(this.history.now);
    }
    this.redraw();
  }

  private beginDrag(at: Point, scale: number, isOther: boolean): void {
    const near = (point: Point): boolean => Math.hypot(point.x - at.x, point.y - at.y) * scale < NEAR;
    const { frame, lines } = this;
    this.drag = null;
    const vertex = lines?.vertices.find(([, , row, column]) => near({ x: column + 0.5, y: row + 0.5 }));
    if (isOther) {
      if (vertex) this.release([vertex[0], vertex[1]]);
    } else if (frame && near(frame[1])) this.drag = { vector: 0 };
    else if (frame && near(frame[2])) this.drag = { vector: 1 };
    else if (frame && near(frame[0]) && this.history.now!.vertices.length === 1) this.drag = "origin";
    else if (vertex) this.drag = { step: [vertex[0], vertex[1]] };
  }

  private dragged(at: Point): LatticeVertices | null {
    const { frame, history } = this;
    const lattice = history.now;
    if (!lattice || !frame || !this.drag) return null;
    const [row, column] = [at.y - 0.5, at.x - 0.5];
    if (this.drag === "origin") return { ...lattice, vertices: [[0, 0, row, column]] };
    if ("step" in this.drag) {
      const [i, j] = this.drag.step;
      return { ...lattice, vertices: [...without(lattice, [i, j]), [i, j, row, column]] };
    }
    const origin = { row: frame[0].y - 0.5, column: frame[0].x - 0.5 };
    const generators: [Vector, Vector] = [...lattice.generators!];
    generators[this.drag.vector] = [row - origin.row, column - origin.column];
    return { vertices: [[0, 0, origin.row, origin.column]], generators };
  }

  private release(step: Vector): void {
    const lattice = this.history.now!;
    const vertices = without(lattice, step);
    if (vertices.length && vertices.length < lattice.vertices.length) this.set({ ...lattice, vertices });
  }

  // -- what it makes

  protected async draft(): Promise<Draft | string> {
    const lattice = this.history.now;
    if (!lattice) return "Detect the lattice, or lay one by two vectors";
    const recipe = { ...this.base(this.flow), files: { "vertices.vertices": "attached:vertices.json" } };
    return { recipe, attached: { "vertices.json": document(lattice) } };
  }

  protected hint(): string {
    return this.busy || (this.history.now ? "Drag the vectors' ends and the vertices" : "Detect the lattice, or lay one by two vectors");
  }

  // -- how it looks

  private readonly over: Over = (context, at, scale) => {
    const { lines, frame } = this;
    if (!lines || !frame) return;
    const places = new Map(lines.vertices.map(([i, j, row, column]) => [`${i},${j}`, at({ x: column + 0.5, y: row + 0.5 })]));
    const path = new Path2D();
    for (const [i, j] of lines.vertices) {
      for (const [down, right] of [[1, 0], [0, 1]]) {
        const end = places.get(`${i + down},${j + right}`);
        if (!end) continue;
        path.moveTo(...places.get(`${i},${j}`)!);
        path.lineTo(...end);
      }
    }
    const placed = new Path2D();
    const radius = Math.min(4, Math.max(1.2, (scale * Math.hypot(frame[1].x - frame[0].x, frame[1].y - frame[0].y)) / 8));
    for (const [i, j, row, column] of this.lattice!.vertices) {
      const [x, y] = places.get(`${i},${j}`) ?? at({ x: column + 0.5, y: row + 0.5 });
      placed.moveTo(x + radius, y);
      placed.arc(x, y, radius, 0, 2 * Math.PI);
    }
    const arrows = new Path2D();
    for (const end of [frame[1], frame[2]]) {
      const [x, y] = at(end);
      arrows.moveTo(...at(frame[0]));
      arrows.lineTo(x, y);
      arrows.moveTo(x + 6, y);
      arrows.arc(x, y, 6, 0, 2 * Math.PI);
    }
    const [left, top] = at({ x: 0, y: 0 });
    context.save();
    context.beginPath();
    context.rect(left - radius, top - radius, this.picture.width * scale + 2 * radius, this.picture.height * scale + 2 * radius);
    context.clip();
    for (const [shape, color, width] of [[path, "#fff", 1], [placed, "#fff", 1.6], [arrows, "#ffe066", 2.4]] as const) {
      [context.strokeStyle, context.lineWidth] = ["rgb(0 0 0 / 0.55)", width + 2];
      context.stroke(shape);
      [context.strokeStyle, context.lineWidth] = [color, width];
      context.stroke(shape);
    }
    context.restore();
  };

  protected panes(): TemplateResult {
    const shown = this.view === "straight" ? this.straight : this.shown;
    return html`
      <figure><figcaption>Exemplar</figcaption>
        <picture-view tool="act" label="Exemplar with its lattice: drag vectors and vertices" .picture=${this.exemplar} .tiles=${this.exemplarTiles}
          .extent=${[this.picture.height, this.picture.width]} .over=${this.over}
          @act=${(event: CustomEvent<Act>) => this.act(event.detail)}></picture-view></figure>
      <figure><figcaption class="row"><span class="segments" role="radiogroup" aria-label="What is shown">
          ${([["straight", "Straightened"], ["result", "Result"]] as const).map(([one, title]) => html`<button role="radio"
            aria-checked=${this.view === one} @click=${() => (this.view = one)}>${title}</button>`)}</span></figcaption>
        <picture-view .picture=${shown} label=${this.view === "straight" ? "Exemplar with its lattice straightened" : "Result"}></picture-view></figure>`;
  }

  protected tools(): TemplateResult {
    const lattice = this.history.now;
    return html`
      <p class="row"><button class="half" ?disabled=${this.busy !== ""} @click=${() => this.detect()}>Detect</button>
        <button class="half" @click=${() => this.begin()}>Two vectors</button></p>
      ${this.busy ? html`<progress aria-label=${this.busy}></progress>` : nothing}
      <p class="hint">${lattice
        ? "Drag the yellow ends to change the vectors, which lays a regular lattice again; drag a vertex to keep it where it is put. A right click lets it follow the others again."
        : "For tiles, grids and weaves: their elements are put in line, and laid on the straightened lattice."}</p>
      ${lattice?.generators ? html`<div class="pairs">${lattice.generators.map((vector, index) => vector.map((value, axis) => html`<label class="field">
          <span>${["Row", "Col."][axis]} ${index + 1}</span>
          <input type="number" step="any" aria-label="${["Row", "Column"][axis]} of vector ${index + 1}" .value=${String(Math.round(100 * value) / 100)}
            @change=${(event: Event) => this.setVector(index, axis, Number((event.target as HTMLInputElement).value))} /></label>`))}</div>` : nothing}
    `;
  }

  private setVector(index: number, axis: number, value: number): void {
    const { frame, history } = this;
    if (!frame || !Number.isFinite(value)) return;
    const generators = history.now!.generators!.map((vector) => [...vector]) as [Vector, Vector];
    generators[index][axis] = value;
    this.set({ vertices: [[0, 0, frame[0].y - 0.5, frame[0].x - 0.5]], generators });
  }
}

const without = (lattice: LatticeVertices, [i, j]: Vector): LatticeVertices["vertices"] =>
  lattice.vertices.filter(([row, column]) => row !== i || column !== j);
