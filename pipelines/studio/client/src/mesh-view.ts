// The layer Mesh: a texture on a surface, with directions and values painted on it in three dimensions.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import type { Corners } from "./corners";
import { amount, meshFields, slider, undoButtons } from "./fields";
import { MaterialLayer } from "./material-layer";
import type { Hit, MeshScene } from "./mesh-scene";
import type { Job, Recipe } from "./messages";
import { fileAddress, keepDocument, mesh, PAINTED, upload } from "./server";
import { sizeText } from "./sizes";
import { TexelMap } from "./texel-map";
import { Undo } from "./undo";

const SIDES = [512, 1024, 2048];
const MAP_SIDE = 512; // px of the painted control map
const TOOLS = { turn: "Turn", direction: "Direction", control: "Amount" } as const;
type Tool = keyof typeof TOOLS;
const BROKEN = 0.1; // of the texture: points of a stroke that are farther apart are on other charts
const STEP = 6; // screen px between points of a stroke

interface Painted {
  strokes: readonly Hit[][];
  codes: Uint8Array | null;
}
const NOTHING: Painted = { strokes: [], codes: null };

@customElement("mesh-view")
export class MeshView extends MaterialLayer {
  protected readonly layer = "mesh";
  @state() private shape = "texloom:torus";
  @state() private side = 1024;
  @state() private tool: Tool = "turn";
  @state() private control = "";
  @state() private code = 255;
  @state() private radius = 20; // hundredths of the mesh's radius
  @state() private painted = new Undo<Painted>(NOTHING);
  @state() private waits = "";
  @query("canvas.mesh") private canvas!: HTMLCanvasElement | null;
  private scene: MeshScene | null = null;
  private corners: Corners | null = null;
  private map: TexelMap | null = null;
  private shown = "";
  private dropped = "";
  private stroke: Hit[] = [];
  private last: [number, number] | null = null;
  private readonly observer = new ResizeObserver(() => this.scene?.draw());

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
    this.scene?.dispose();
  }

  protected override onChange = (): void => {
    const { run } = this;
    if (run?.state === "done" && this.shown !== run.id) void this.show(run);
    if (this.dropped !== this.studio.mesh && this.canvas?.checkVisibility()) void this.unfold((this.dropped = this.studio.mesh));
    this.requestUpdate();
  };

  // -- what is shown

  protected override async open(): Promise<void> {
    this.control = "";
    this.dropped = this.studio.mesh;
    if (this.dropped) this.shape = this.dropped;
    await this.updateComplete;
    if (!this.scene) await this.unfold(this.shape);
  }

  private async unfold(shape: string): Promise<void> {
    this.shape = shape;
    this.waits = "Unfolding the mesh …";
    const [corners, { MeshScene }] = await Promise.all([this.studio.attempt(mesh(shape, this.side)), import("./mesh-scene")]);
    if (this.shape !== shape) return; // another one was chosen meanwhile, and is waited for
    this.waits = "";
    if (!corners || !this.canvas) return;
    if (!this.scene) this.observer.observe(this.canvas);
    this.scene ??= new MeshScene(this.canvas);
    // What is painted belongs to the texture coordinates, which may be others at another size.
    const isSame = this.corners?.length === corners.length && this.corners.every((value, index) => value === corners[index]);
    if (!isSame) [this.map, this.painted] = [null, new Undo(NOTHING)];
    [this.corners, this.job] = [corners, ""];
    this.scene.setMesh(corners);
    this.restore();
    this.use("turn");
    if (this.begun && !this.run) void this.studio.attempt(this.scene.setMaps({ albedo: await createImageBitmap(this.begun) }));
  }

  private async show(job: Job): Promise<void> {
    this.shown = job.id;
    const maps = Object.fromEntries(Object.entries(job.maps).map(([role, file]) => [role, fileAddress(job.id, file)]));
    await this.studio.attempt(this.scene!.setMaps(maps));
    this.use("turn");
    this.setAttribute("ready", job.id);
  }

  private use(tool: Tool): void {
    this.tool = tool;
    this.scene?.setTurning(tool === "turn");
    if (tool === "control" && !this.map && this.corners) {
      this.map = new TexelMap(this.corners, MAP_SIDE, 0);
    }
    this.scene?.showValues(tool === "control" ? this.map : null);
  }

  /** Show the state that undo has. */
  private restore(): void {
    const { strokes, codes } = this.painted.now;
    this.scene?.setStrokes(strokes);
    if (this.map) this.map.restore(codes ?? new Uint8Array(MAP_SIDE ** 2));
    this.scene?.updateValues();
    this.requestUpdate();
  }

  private undo(direction: "undo" | "redo"): void {
    this.painted[direction]();
    this.restore();
  }

  // -- painting

  private down(event: PointerEvent): void {
    if (this.tool === "turn" || event.button !== 0 || !this.canvas) return;
    this.canvas.setPointerCapture(event.pointerId);
    [this.stroke, this.last] = [[], null];
    this.move(event);
  }

  private move(event: PointerEvent): void {
    if (this.tool === "turn" || !event.buttons || !this.canvas || !this.scene) return;
    const before = this.last ?? [event.clientX, event.clientY];
    const count = Math.max(1, Math.ceil(Math.hypot(event.clientX - before[0], event.clientY - before[1]) / STEP));
    const box = this.canvas.getBoundingClientRect();
    for (let step = 1; step <= count; step += 1) {
      const at = (from: number, to: number) => from + ((to - from) * step) / count;
      const [x, y] = [at(before[0], event.clientX), at(before[1], event.clientY)];
      const hit = this.scene.pick((x - box.left) / box.width, (y - box.top) / box.height);
      if (!hit) continue;
      if (this.tool === "control") this.map!.dab(hit.point, (this.radius / 100) * this.scene.radius, this.code);
      else this.stroke.push(hit);
    }
    this.last = [event.clientX, event.clientY];
    if (this.tool === "control") this.scene.updateValues();
    else this.scene.setStrokes([...this.painted.now.strokes, this.stroke]);
  }

  private up(): void {
    if (!this.last) return;
    this.last = null;
    const { strokes, codes } = this.painted.now;
    if (this.tool === "control") this.painted.set({ strokes, codes: this.map!.codes.slice() });
    else if (this.stroke.length > 1) this.painted.set({ strokes: [...strokes, this.stroke], codes });
    this.requestUpdate();
  }

  // -- results

  protected override async drawn(): Promise<Recipe | undefined> {
    return this.studio.attempt(this.described());
  }

  private async described(): Promise<Recipe> {
    const { strokes, codes } = this.painted.now;
    const sources: Record<string, string> = { exemplar: this.picture.id, mesh: this.shape };
    const lines = strokes.flatMap((one) => pieces(one, this.side));
    if (lines.length) sources.strokes = await keepDocument("strokes", { size: sizeText([this.side, this.side]), strokes: lines, width: 3 });
    if (codes && this.control) {
      const blob = await new Promise<Blob | null>((done) => this.map!.canvas.toBlob(done, "image/png"));
      sources.control = this.control;
      sources.target = (await upload([new File([blob!], `${PAINTED}target.png`)], "")).id;
    }
    return { flow: "on_mesh", sources, size: sizeText([this.side, this.side]), seed: this.recipe.seed };
  }

  // -- how it looks

  override render(): TemplateResult {
    return html`
      <section class="stage" aria-label="Mesh">
        <div class="bar">
          <div class="segments" role="radiogroup" aria-label="What dragging does">
            ${(Object.keys(TOOLS) as Tool[]).map((tool) => html`<button role="radio" aria-checked=${tool === this.tool}
              ?disabled=${!this.corners} @click=${() => this.use(tool)}>${TOOLS[tool]}</button>`)}
          </div>
          ${undoButtons(this.painted, (direction) => this.undo(direction))}
          <span class="state" role="status">${this.status()}</span>
        </div>
        <div class="space"><canvas class="mesh" tabindex="0" role="img" aria-label="Mesh"
          @pointerdown=${this.down} @pointermove=${this.move} @pointerup=${this.up} @pointercancel=${this.up}></canvas></div>
      </section>
      <aside class="right" aria-label="Texture on the mesh">${this.cards(this.settings())} ${this.ending("Make the texture", this.corners !== null)}</aside>
    `;
  }

  private status(): string {
    if (this.waits) return this.waits;
    if (this.tool === "direction") return "Draw lines along which the texture's columns run";
    if (this.tool === "control") return this.control ? "Paint how much there is of what leads it" : "Choose first what leads it: a grey map of the picture";
    return "Drag to turn";
  }

  private settings(): TemplateResult {
    const { picture } = this;
    const maps = [...this.studio.pictures, ...this.studio.begin.examples].filter(
      (one) => one.id !== picture.id && one.height === picture.height && one.width === picture.width && !one.is_material,
    );
    return html`
      ${meshFields(this.studio.meshes, this.shape, this.studio.begin.mesh_suffixes, (one) => void this.unfold(one), (file) => void this.studio.takeMesh(file))}
      <div class="chips" role="group" aria-label="Size of the texture">${SIDES.map((side) => html`<button aria-pressed=${side === this.side}
        @click=${() => {
          this.side = side;
          void this.unfold(this.shape);
        }}>${side}</button>`)}</div>
      <label class="field"><span>Led by</span><select aria-label="Control map of the exemplar"
        @change=${(event: Event) => (this.control = (event.target as HTMLSelectElement).value)}>
        <option value="">none</option>
        ${maps.map((one) => html`<option value=${one.id} ?selected=${one.id === this.control}>${one.name}</option>`)}</select></label>
      ${this.tool === "control" ? html`${amount("Amount", this.code, (code) => (this.code = code))}
        ${slider("Brush radius", this.radius, 100, (value) => (this.radius = Math.max(1, value)))}` : nothing}
    `;
  }
}

/** A stroke as lines of the texture, px, cut where it goes on in another chart. */
function pieces(stroke: readonly Hit[], side: number): [number, number][][] {
  const lines: [number, number][][] = [];
  let before: Hit | null = null;
  for (const hit of stroke) {
    if (!before || Math.hypot(hit.row - before.row, hit.column - before.column) > BROKEN) lines.push([]);
    lines.at(-1)!.push([hit.row * side - 0.5, hit.column * side - 0.5]);
    before = hit;
  }
  return lines.filter((line) => line.length > 1);
}
