// The layer Paint: a control map under the brush, and the texture that follows it.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import { type Area, ControlMap, decoded, joined } from "./control-map";
import { amount, failure, slider, undoButtons } from "./fields";
import { MaterialLayer } from "./material-layer";
import type { Recipe, ToPage } from "./messages";
import { PaintCanvas } from "./paint-canvas";
import { bitmap, PAINTED, pictureAddress, upload } from "./server";
import { sizeText } from "./sizes";
import type { Payload } from "./studio";

const FLOW = "per_pixel_control";
const SIDES = [256, 512, 1024];
const PICK = 256; // px of the original from which values are picked
const SEED = 7;
const MOST_KEPT = 2 ** 19; // characters of a map that the project keeps
const LARGEST_KEPT = 256; // px of a side of one that would take more

@customElement("paint-view")
export class PaintView extends MaterialLayer {
  protected readonly layer = "paint";
  @state() private control = "";
  @state() private side = 512;
  @state() private code = 255;
  @state() private radius = 40;
  @state() private hardness = 0.5;
  @state() private shows: "texture" | "map" = "texture";
  @query("canvas.result") private canvas!: HTMLCanvasElement;
  @query("canvas.cursor") private cursor!: HTMLCanvasElement;
  private map = new ControlMap(this.side, this.side);
  private followed!: PaintCanvas;
  private values: ImageData | null = null;
  private last: { x: number; y: number } | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.followed ??= new PaintCanvas(this.studio, () => this.map, () => this.requestUpdate());
    this.studio.addEventListener("renewed", this.onRenewed);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.studio.removeEventListener("renewed", this.onRenewed);
  }

  private readonly onRenewed = (): void => this.followed.renew();

  // -- opening

  protected override async open(): Promise<void> {
    const { picture } = this;
    const drawn = this.kept?.paint ?? null;
    [this.control, this.side] = [drawn?.control ?? "", drawn?.side ?? this.side];
    this.map = new ControlMap(this.side, this.side);
    this.forget();
    const painted = drawn && (await this.studio.attempt(decoded(drawn.map)));
    if (!painted || picture !== this.picture) return;
    this.map = new ControlMap(this.side, this.side, painted);
    this.begin();
  }

  /** What has been opened is of another original, control map or size. */
  private forget(): void {
    this.job = "";
    this.followed.forget();
    this.requestUpdate();
  }

  /** Open a canvas of the map, which is stretched where it had another size. */
  private begin(): void {
    if (this.map.width !== this.side) this.map = new ControlMap(this.side, this.side, this.map.canvas());
    this.job = "";
    this.followed.begin({ picture: this.picture, control: this.control, seed: this.recipe.seed ?? SEED });
    this.keepDrawn();
    this.requestUpdate();
  }

  /** Let the project have what is painted; a map that takes much room smaller. */
  private keepDrawn(): void {
    const whole = this.map.address(this.side);
    const map = whole.length > MOST_KEPT ? this.map.address(LARGEST_KEPT) : whole;
    this.keep({ paint: { control: this.control, side: this.side, map } });
  }

  protected override receive(message: ToPage, payload: Payload): void {
    if (this.followed.receive(message, payload)) void this.loadValues();
  }

  /** The values of the control map, for picking. */
  private async loadValues(): Promise<void> {
    const picture = await this.studio.attempt(bitmap(pictureAddress(this.followed.control, PICK)));
    if (!picture) return;
    const context = new OffscreenCanvas(picture.width, picture.height).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    this.values = context.getImageData(0, 0, picture.width, picture.height);
  }

  // -- painting

  private changed(area: Area): void {
    if (this.shows === "map") this.draw();
    this.followed.follow(area);
  }

  private down(event: PointerEvent): void {
    if (!event.isPrimary) return; // a second finger does not paint
    this.canvas.setPointerCapture(event.pointerId);
    this.last = null;
    this.move(event);
  }

  private move(event: PointerEvent): void {
    if (!event.isPrimary) return;
    const box = this.canvas.getBoundingClientRect();
    const scale = this.side / box.width;
    const at = { x: (event.clientX - box.left) * scale, y: (event.clientY - box.top) * scale };
    this.drawCursor(event.clientX, event.clientY, this.radius / scale);
    if (!event.buttons || !this.followed.canPaint) return;
    const from = this.last ?? at;
    const steps = Math.max(1, Math.ceil(Math.hypot(at.x - from.x, at.y - from.y) / (this.radius / 3)));
    let area: Area | null = null;
    for (let step = 1; step <= steps; step += 1) {
      const [x, y] = [from.x + ((at.x - from.x) * step) / steps, from.y + ((at.y - from.y) * step) / steps];
      area = joined(area, this.map.dab(x, y, this.radius, this.code, this.hardness));
    }
    this.last = at;
    this.changed(area!);
  }

  private up(): void {
    if (!this.last) return;
    this.last = null;
    this.map.keep();
    this.keepDrawn();
    this.requestUpdate();
  }

  private whole(change: () => void): void {
    change();
    this.changed(this.map.whole);
    this.keepDrawn();
    this.requestUpdate();
  }

  private pick(event: MouseEvent): void {
    if (!this.values) return;
    const box = (event.target as HTMLElement).getBoundingClientRect();
    const column = Math.floor(((event.clientX - box.left) / box.width) * this.values.width);
    const row = Math.floor(((event.clientY - box.top) / box.height) * this.values.height);
    this.code = this.values.data[4 * (row * this.values.width + column)];
  }

  private async load(event: Event): Promise<void> {
    const file = (event.target as HTMLInputElement).files?.[0];
    const kept = file && (await this.studio.attempt(upload([file], "")));
    const picture = kept && (await this.studio.attempt(bitmap(pictureAddress(kept.id, 2048))));
    if (picture) this.whole(() => this.map.load(picture));
  }

  // -- results

  protected override async drawn(): Promise<Recipe | undefined> {
    const blob = await new Promise<Blob | null>((done) => this.map.canvas().toBlob(done, "image/png"));
    const target = await this.studio.attempt(upload([new File([blob!], `${PAINTED}target.png`)], ""));
    if (!target) return undefined;
    const sources = { texture: this.picture.id, control: this.followed.control, target: target.id };
    return { flow: FLOW, sources, size: sizeText([this.side, this.side]), seed: this.recipe.seed };
  }

  // -- how it looks

  private draw(): void {
    const shown = this.shows === "map" ? this.map.canvas() : this.followed.pixels;
    if (!this.canvas || !shown) return;
    if (this.canvas.width !== this.side) [this.canvas.width, this.canvas.height] = [this.side, this.side];
    this.canvas.getContext("2d")!.drawImage(shown, 0, 0, this.side, this.side);
  }

  private drawCursor(x: number, y: number, radius: number): void {
    const box = this.cursor.getBoundingClientRect();
    [this.cursor.width, this.cursor.height] = [box.width, box.height];
    const context = this.cursor.getContext("2d")!;
    for (const [style, width] of [["rgb(0 0 0 / 0.6)", 3], ["#fff", 1.2]] as const) {
      [context.strokeStyle, context.lineWidth] = [style, width];
      context.beginPath();
      context.arc(x - box.left, y - box.top, radius, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  protected override updated(): void {
    this.draw();
  }

  override render(): TemplateResult {
    return html`
      <section class="stage" aria-label="Canvas">${this.stage()}</section>
      <aside class="right" aria-label="Brush">${this.cards(this.settings())} ${this.followed.state === "ready" ? this.ending("Finish with all maps") : nothing}</aside>
    `;
  }

  private stage(): TemplateResult {
    return html`
      <div class="bar">
        <div class="segments" role="radiogroup" aria-label="What is shown">
          ${(["texture", "map"] as const).map((one) => html`<button role="radio" aria-checked=${this.shows === one}
            @click=${() => (this.shows = one)}>${one === "map" ? "Map" : "Texture"}</button>`)}
        </div>
        ${undoButtons(this.map, (direction) => this.whole(() => this.map.step(direction)))}
        <span class="state" role="status">${this.status()}</span>
      </div>
      <div class="painted">
        <canvas class="result" aria-label="Canvas: paint with the pointer" role="img" ?hidden=${!this.followed.canPaint}
          @pointerdown=${this.down} @pointermove=${this.move} @pointerup=${this.up}></canvas>
        <canvas class="cursor" aria-hidden="true"></canvas>
      </div>
      ${this.followed.state === "none" ? html`<div class="welcome over">
        <h2>What controls it?</h2>
        <p>Choose a grey map of the picture on the right that says what is where in it, such as wetness, rust or height, or paint by
          its brightness. A draft is there within seconds; summarising the picture takes a minute or two, once.</p><p><button class="primary" @click=${() => this.begin()}>Begin to paint</button></p></div>` : nothing}
      ${["opening", "draft"].includes(this.followed.state) ? html`<progress class="line" aria-label="Summary"></progress>` : nothing}
    `;
  }

  private status(): string | TemplateResult {
    const { problem, state, progress } = this.followed;
    if (problem) return failure(problem, () => this.begin());
    if (state === "opening") return `Summarising the original, once: ${progress || "starting"}`;
    if (state === "draft") return `Paint this draft while the original is summarised, once: ${progress || "starting"}`;
    return state === "ready" ? "Paint: the texture follows" : "";
  }

  private settings(): TemplateResult {
    const { picture } = this;
    const maps = [...this.studio.pictures, ...this.studio.begin.examples].filter(
      (one) => one.id !== picture.id && Math.abs(one.height * picture.width - one.width * picture.height) <= Math.max(picture.height, picture.width),
    );
    return html`
      <label class="field"><span>Led by</span>
        <select aria-label="Control map" @change=${(event: Event) => {
          this.control = (event.target as HTMLSelectElement).value;
          this.forget();
        }}>
          <option value="" ?selected=${!this.control}>its brightness</option>
          ${maps.map((one) => html`<option value=${one.id} ?selected=${one.id === this.control}>${one.name}</option>`)}
        </select></label>
      <div class="chips" role="group" aria-label="Size of the canvas">${SIDES.map((side) => html`<button
        aria-pressed=${side === this.side} @click=${() => {
          this.side = side;
          this.forget();
        }}>${side}</button>`)}</div>
      ${this.followed.canPaint ? this.brush() : nothing}
    `;
  }

  private brush(): TemplateResult {
    return html`
      <img class="pick" src=${pictureAddress(this.picture.id, PICK)} alt="The original: click to paint what is there" title="Click to paint what is there" @click=${this.pick} />
      <div class="swatch" style="background: rgb(${this.code} ${this.code} ${this.code})"></div>
      ${amount("Amount", this.code, (code) => (this.code = code))}
      ${slider("Brush radius", this.radius, 200, (value) => (this.radius = Math.max(2, value)))}
      ${slider("Hardness", Math.round(100 * this.hardness), 99, (value) => (this.hardness = value / 100))}
      <p class="row"><label class="button half">Load a map<input type="file" accept="image/*" aria-label="Load a map" @change=${this.load} /></label>
        <button class="half" @click=${() => this.whole(() => this.map.fill(this.code))}>Fill</button></p>
    `;
  }
}
