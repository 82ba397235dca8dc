// The layer Mesh: a texture on a surface, with directions and values painted on it in three dimensions.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import type { Corners } from "./corners";
import { document as contentOf, type Draft, kept, picture } from "./drafts";
import { amount, meshFields, slider, undoButtons } from "./fields";
import { mapAddress } from "./large-pictures";
import { LayerPreview } from "./layer-preview";
import { MaterialLayer } from "./material-layer";
import type { MeshScene } from "./mesh-scene";
import { type Hit, linesOf, NOTHING, type Painted } from "./mesh-strokes";
import type { DrawnMesh, Job, Recipe, ToPage } from "./messages";
import { mesh } from "./server";
import { screenPixels, sizeText } from "./sizes";
import type { Payload } from "./studio";
import { TexelMap } from "./texel-map";
import { Undo } from "./undo";

const SIDES = [512, 1024, 2048];
const MAP_SIDE = 512; // px of the painted control map
const TOOLS = { turn: "Turn", direction: "Direction", control: "Amount" } as const;
type Tool = keyof typeof TOOLS;
const STEP = 6; // screen px between points of a stroke

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
  private preview!: LayerPreview;
  private previewed: HTMLCanvasElement | null = null;
  private readonly observer = new ResizeObserver(() => this.scene?.draw());

  override connectedCallback(): void {
    super.connectedCallback();
    this.preview ??= new LayerPreview(this.studio, () => this.draft(), () => screenPixels(this.canvas), () => this.onPreview());
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
    this.scene?.dispose();
  }

  protected override onChange = (): void => {
    const { run } = this;
    if (run?.state === "done" && this.shown !== run.id) void this.show(run);
    if (this.dropped !== this.studio.mesh && this.canvas?.checkVisibility()) void this.choose((this.dropped = this.studio.mesh), this.side);
    this.requestUpdate();
  };

  // -- what is shown

  protected override async open(): Promise<void> {
    const drawn = this.kept?.mesh ?? null;
    this.control = drawn?.control ?? "";
    this.dropped = this.studio.mesh;
    [this.shape, this.side] = [drawn?.mesh ?? (this.dropped || this.shape), drawn?.side ?? this.side];
    await this.updateComplete;
    if (!this.scene || drawn) await this.unfold(this.shape);
    if (drawn && this.corners) await this.studio.attempt(this.goOn(drawn));
    this.preview.ask();
  }

  /** Go on with what was drawn before the page was loaded. */
  private async goOn({ strokes, amounts }: DrawnMesh): Promise<void> {
    if (amounts) this.map ??= new TexelMap(this.corners!, MAP_SIDE, 0);
    this.painted = new Undo<Painted>({ strokes, codes: amounts ? await this.map!.load(amounts) : null });
    this.restore();
  }

  /** Let the project have what is drawn. */
  private keepDrawn(): void {
    const { strokes, codes } = this.painted.now;
    this.keep({ mesh: { mesh: this.shape, side: this.side, control: this.control, strokes: [...strokes], amounts: codes ? this.map!.address : "" } });
  }

  private async choose(shape: string, side: number): Promise<void> {
    this.side = side;
    this.preview.stop();
    await this.unfold(shape);
    this.drew();
  }

  /** Something has changed: keep it, and show what that makes. */
  private drew(): void {
    this.job = "";
    this.keepDrawn();
    this.preview.ask();
  }

  protected override receive(message: ToPage, payload: Payload): void {
    this.preview.receive(message, payload);
  }

  /** Show the preview, in place of the painted amounts when the hand that paints them has been lifted. */
  private onPreview(): void {
    const { picture } = this.preview;
    this.requestUpdate();
    if (!picture || picture === this.previewed || !this.scene || this.run) return;
    this.previewed = picture;
    void this.studio.attempt(this.scene.setMaps({ albedo: picture }));
    if (!this.last && this.control) this.scene.showValues(null);
  }

  protected override pause(): void {
    this.preview.stop();
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
    const maps = Object.fromEntries(Object.entries(job.maps).map(([role, file]) => [role, mapAddress(job, file)]));
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
    this.drew();
  }

  // -- painting

  private down(event: PointerEvent): void {
    if (this.tool === "turn" || event.button !== 0 || !this.canvas) return;
    this.canvas.setPointerCapture(event.pointerId);
    [this.stroke, this.last] = [[], null];
    if (this.tool === "control") this.scene?.showValues(this.map);
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
      if (this.tool === "control") this.map!.dab(hit, (this.radius / 100) * this.scene.radius, this.code);
      else this.stroke.push(hit);
    }
    this.last = [event.clientX, event.clientY];
    if (this.tool === "control") this.scene.updateValues();
    else this.scene.setStrokes([...this.painted.now.strokes, this.stroke]);
    this.preview.follow();
  }

  private up(): void {
    if (!this.last) return;
    const { strokes, codes } = this.now;
    const { now } = this.painted;
    this.last = null;
    if (strokes === now.strokes && codes === now.codes) return;
    this.painted.set({ strokes, codes: codes === now.codes ? codes : this.map!.codes.slice() });
    this.drew();
  }

  /** What is drawn, also what a hand is drawing. */
  private get now(): Painted {
    const { strokes, codes } = this.painted.now;
    if (!this.last) return { strokes, codes };
    if (this.tool === "control") return { strokes, codes: this.map!.codes };
    return { strokes: this.stroke.length > 1 ? [...strokes, this.stroke] : strokes, codes };
  }

  // -- results

  protected override async drawn(): Promise<Recipe | undefined> {
    return this.studio.attempt(this.draft().then(kept));
  }

  private async draft(): Promise<Draft> {
    const { strokes, codes } = this.now;
    const attached: Record<string, Blob> = {};
    const sources: Record<string, string> = { exemplar: this.picture.id, mesh: this.shape };
    const lines = strokes.flatMap((one) => linesOf(one, this.side));
    if (lines.length) {
      attached["strokes.json"] = contentOf({ size: sizeText([this.side, this.side]), strokes: lines, width: 3 });
      sources.strokes = "attached:strokes.json";
    }
    if (codes && this.control) {
      attached["target.png"] = await picture(this.map!.canvas);
      [sources.control, sources.target] = [this.control, "attached:target.png"];
    }
    return { recipe: { flow: "on_mesh", sources, size: sizeText([this.side, this.side]), seed: this.recipe.seed }, attached };
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
    if (this.preview.problem) return this.preview.problem;
    const hints = {
      turn: "Drag to turn", direction: "Draw lines along which columns run",
      control: this.control ? "Paint how much there is of what leads it" : "Choose first what leads it: a grey map",
    };
    return [hints[this.tool], this.run ? "" : this.preview.status].filter(Boolean).join(". ");
  }

  private settings(): TemplateResult {
    const { picture } = this;
    const maps = [...this.studio.pictures, ...this.studio.begin.examples].filter(
      (one) => one.id !== picture.id && one.height === picture.height && one.width === picture.width && !one.is_material,
    );
    return html`
      ${meshFields(this.studio.meshes, this.shape, this.studio.begin.mesh_suffixes, (one) => void this.choose(one, this.side), (file) => void this.studio.takeMesh(file))}
      <div class="chips" role="group" aria-label="Size of the texture">${SIDES.map((side) => html`<button aria-pressed=${side === this.side}
        @click=${() => void this.choose(this.shape, side)}>${side}</button>`)}</div>
      <label class="field"><span>Led by</span><select aria-label="Control map of the exemplar"
        @change=${(event: Event) => {
          this.control = (event.target as HTMLSelectElement).value;
          this.drew();
        }}>
        <option value="">none</option>
        ${maps.map((one) => html`<option value=${one.id} ?selected=${one.id === this.control}>${one.name}</option>`)}</select></label>
      ${this.tool === "control" ? html`${amount("Amount", this.code, (code) => (this.code = code))}
        ${slider("Brush radius", this.radius, 100, (value) => (this.radius = Math.max(1, value)))}` : nothing}
    `;
  }
}
