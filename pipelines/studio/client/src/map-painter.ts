// A small grey map that is painted over a result: which picture lies where, or how far a trend is there.
import { html, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { ControlMap } from "./control-map";
import { Element } from "./element";
import { choice, slider } from "./fields";
import { alongWay } from "./path-trend";
import type { Act, Point } from "./picture-view";
import "./picture-view";
import { bitmap, PAINTED, pictureAddress, upload } from "./server";
import type { Studio } from "./studio";

const SIDE = 192; // px of the longer side; the map is stretched over the result
const WHITE = 255;
const HARDNESS = 0.5;
const APART = 3; // px between points of a way that is drawn
const TOOLS = { brush: "Brush", way: "Way" };

/** Tells `painted` with the id of the map, after each stroke. */
@customElement("map-painter")
export class MapPainter extends Element {
  @property({ attribute: false }) studio!: Studio;
  /** height and width of the result, px */
  @property({ attribute: false }) size: [number, number] = [SIDE, SIDE];
  /** the id of the map that is used now; empty: none */
  @property() chosen = "";
  /** what black and white mean */
  @property({ attribute: false }) ends: [string, string] = ["black", "white"];
  @state() private percent = 100;
  @state() private radius = 24;
  @state() private canvas: HTMLCanvasElement | null = null;
  private map = new ControlMap(SIDE, SIDE);
  private told = ""; // the id of what `map` holds
  private last: Point | null = null;
  private strokes = 0;
  @state() private tool: keyof typeof TOOLS = "brush";
  private way: Point[] = [];
  private isDrawn = false; // whether the way is drawn, not clicked point by point

  protected override willUpdate(changed: Map<string, unknown>): void {
    const scale = SIDE / Math.max(...this.size);
    const [height, width] = this.size.map((side) => Math.max(16, Math.round(side * scale)));
    const isOther = height !== this.map.height || width !== this.map.width;
    if (isOther || (changed.has("chosen") && !this.chosen && this.told)) this.map = new ControlMap(height, width);
    if (this.chosen && (isOther || this.chosen !== this.told)) void this.load(this.chosen);
    if (!this.chosen) this.told = "";
    if (!this.canvas || isOther || changed.has("chosen")) this.canvas = this.map.canvas();
  }

  override render(): TemplateResult {
    return html`<div class="painter">
      <picture-view class="tool" .picture=${this.canvas} tool="act" label="Map to paint"
        @act=${(event: CustomEvent<Act>) => this.act(event.detail)}></picture-view>
      ${choice("Tool", TOOLS, this.tool, (tool) => this.use(tool))}
      ${this.tool === "way"
        ? html`<p class="hint">Draw a way, or click its corners: black, ${this.ends[0]}, where it begins; white, ${this.ends[1]}, where it ends.</p>
            <button ?disabled=${!this.way.length} @click=${() => this.use("way")}>Another way</button>`
        : html`${slider("Paint", this.percent, 100, (percent) => (this.percent = percent))}
            <span class="ends"><span>${this.ends[0]}</span><span>${this.ends[1]}</span></span>
            ${slider("Radius", this.radius, SIDE / 2, (radius) => (this.radius = Math.max(1, radius)))}
            <button @click=${() => this.fill()}>Fill</button>`}
    </div>`;
  }

  private use(tool: keyof typeof TOOLS): void {
    [this.tool, this.way, this.isDrawn] = [tool, [], false];
    this.requestUpdate();
  }

  /** Show a map that has been painted or chosen before. */
  private async load(id: string): Promise<void> {
    this.told = id;
    const loaded = await this.studio.attempt(bitmap(pictureAddress(id, SIDE)));
    if (!loaded || id !== this.told) return;
    this.map.load(loaded);
    this.canvas = this.map.canvas();
  }

  private act({ phase, x, y, isOther }: Act): void {
    if (this.tool === "way") return this.draw(phase, { x, y });
    if (phase === "begin") this.last = { x, y };
    if (this.last && (phase === "begin" || phase === "drag")) this.line(this.last, { x, y }, isOther);
    if (this.last && (phase === "end" || phase === "cancel")) void this.keep();
    if (phase === "end" || phase === "cancel") this.last = null;
  }

  /** A way that is drawn, or clicked corner after corner; the map follows it. */
  private draw(phase: Act["phase"], at: Point): void {
    const last = this.way.at(-1);
    if (phase === "begin") {
      this.way = this.isDrawn ? [at] : [...this.way, at];
      [this.isDrawn, this.last] = [false, at];
    } else if (phase === "drag" && this.last && last && Math.hypot(at.x - last.x, at.y - last.y) >= APART) {
      if (!this.isDrawn) this.way = [last];
      [this.isDrawn, this.way] = [true, [...this.way, at]];
    } else if (phase !== "end") return;
    const codes = alongWay(this.way, this.map.height, this.map.width);
    if (codes) this.map.take(codes);
    if (codes) this.canvas = this.map.canvas();
    if (phase === "end" && codes) void this.keep();
    if (phase === "end") this.last = null;
    this.requestUpdate();
  }

  /** Paint from one point to the next; the other button paints the opposite. */
  private line(from: Point, to: Point, isOther: boolean): void {
    const code = Math.round((WHITE * (isOther ? 100 - this.percent : this.percent)) / 100);
    const steps = Math.max(1, Math.ceil((4 * Math.hypot(to.x - from.x, to.y - from.y)) / this.radius));
    for (let step = 1; step <= steps; step += 1) {
      const at = step / steps;
      this.map.dab(from.x + at * (to.x - from.x), from.y + at * (to.y - from.y), this.radius, code, HARDNESS);
    }
    this.last = to;
    this.canvas = this.map.canvas();
  }

  private fill(): void {
    this.map.fill(Math.round((WHITE * this.percent) / 100));
    this.canvas = this.map.canvas();
    void this.keep();
  }

  /** Give the map to the library, and tell its id unless there is a later stroke. */
  private async keep(): Promise<void> {
    this.strokes += 1;
    const stroke = this.strokes;
    const content = await new Promise<Blob | null>((done) => this.map.canvas().toBlob(done, "image/png"));
    const kept = content && (await this.studio.attempt(upload([new File([content], `${PAINTED}map.png`)], "")));
    if (!kept || stroke !== this.strokes) return;
    this.told = kept.id;
    this.tell("painted", kept.id);
  }
}
