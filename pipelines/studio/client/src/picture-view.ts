// A picture to look at: fitted, repeated without end, or beside the exemplar; panned and zoomed by hand or keys.
import { html, type TemplateResult } from "lit";
import { customElement, property, query } from "lit/decorators.js";
import { Element } from "./element";

export interface Point {
  x: number;
  y: number;
}
export interface Patch {
  picture: Drawable;
  x: number;
  y: number;
}
/** What a hand or the keys do in a picture, at a place in its pixels, of which each is 1 wide. */
export interface Act extends Point {
  phase: "hover" | "begin" | "drag" | "end" | "cancel" | "leave";
  /** screen pixels of a pixel */
  scale: number;
  /** the right button, or the eraser of a pen */
  isOther: boolean;
  isDouble: boolean;
}
/** Draws over a picture; ``at`` gives the place in the view of one in the picture's pixels. */
export type Over = (context: CanvasRenderingContext2D, at: (point: Point) => [number, number], scale: number) => void;
/** What of a picture is in view: screen pixels that it is wide, 0 where it fits, and the middle in shares of it. */
export interface Look extends Point {
  span: number;
}
export const FITTED: Look = { span: 0, x: 0.5, y: 0.5 };
export type Mode = "single" | "repeat" | "compare";
export type Drawable = ImageBitmap | HTMLCanvasElement;

const ZOOM_STEP = 1.2;
const LARGEST = 32; // screen pixels of a pixel
const PAN_STEP = 48; // px of an arrow key
const KEY_STEP = 12; // screen pixels that a key moves a tool
const STEPS: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

@customElement("picture-view")
export class PictureView extends Element {
  @property({ attribute: false }) picture: Drawable | null = null;
  @property({ attribute: false }) exemplar: Drawable | null = null;
  /** how large the exemplar's pixels are, in pixels of the picture */
  @property({ type: Number }) exemplarScale = 1;
  /** whether it stands for a larger picture, whose pixels are not these */
  @property({ type: Boolean }) isReduced = false;
  @property() mode: Mode = "single";
  @property() label = "Texture";
  /** what dragging does: pan; draw around a spot, when `lasso` is told, with points of the picture; or what those make
   * of it that listen to `act` */
  @property() tool: "pan" | "lasso" | "act" = "pan";
  /** height and width that the picture is shown at, if not its own, px */
  @property({ attribute: false }) extent: [number, number] | null = null;
  @property({ attribute: false }) over: Over | null = null;
  /** a line around a spot, in pixels of the picture */
  @property({ attribute: false }) outline: Point[] = [];
  /** places that are numbered */
  @property({ attribute: false }) marks: Point[] = [];
  /** a part that is shown in place of what is there */
  @property({ attribute: false }) patch: Patch | null = null;
  /** what is in view, where that is the same of several pictures; each of them tells `look` when it is moved */
  @property({ attribute: false }) look: Look | null = null;
  @query("canvas") protected canvas!: HTMLCanvasElement;

  protected zoom = 0; // screen pixels of a pixel; 0 fits
  protected center = { x: 0.5, y: 0.5 }; // of the view, in shares of the picture
  private split = 0.5;
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private isSplitting = false;
  private isDrawing = false;
  private drawn: Point[] = []; // the line so far; `outline` is set again whenever something around this element changes
  private isActing = false;
  private cursor: Point | null = null; // moved by keys
  private shown: Drawable | null = null;
  private readonly observer = new ResizeObserver(() => this.draw());

  override render(): TemplateResult {
    return html`<canvas
      tabindex="0"
      role="img"
      aria-label=${`${this.label}. Arrow keys pan, plus and minus zoom, 0 fits${this.tool === "act" ? "; Shift and arrow keys move the tool, Space uses it" : ""}`}
      @pointerdown=${this.down}
      @pointermove=${this.move}
      @pointerup=${this.up}
      @pointercancel=${this.up}
      @pointerleave=${this.leave}
      @contextmenu=${(event: Event) => this.tool === "act" && event.preventDefault()}
      @wheel=${this.wheel}
      @dblclick=${() => this.tool === "act" || this.fit()}
      @keydown=${this.key}
      @keyup=${(event: KeyboardEvent) => event.key === " " && this.tool === "act" && this.release("end")}
    ></canvas>`;
  }

  protected override firstUpdated(): void {
    this.observer.observe(this.canvas);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
  }

  protected override updated(): void {
    const [before, now] = [this.shown, this.picture];
    if (!this.extent && before && now && this.zoom && before.width !== now.width) this.zoom *= before.width / now.width;
    this.shown = now;
    if (this.look && this.size) {
      const { span, x, y } = this.look;
      [this.zoom, this.center] = [span / this.size.width, { x, y }];
    }
    this.draw();
  }

  fit(): void {
    this.zoom = 0;
    this.center = { x: 0.5, y: 0.5 };
    this.moved();
  }

  /** Draw what is in view now, and tell those that show as much. */
  private moved(): void {
    this.draw();
    if (this.look) this.tell<Look>("look", { span: this.zoom * (this.size?.width ?? 0), ...this.center });
  }

  /** Width and height that the picture is shown at. */
  protected get size(): { width: number; height: number } | null {
    return this.extent ? { width: this.extent[1], height: this.extent[0] } : this.picture;
  }

  /** Screen pixels of a pixel of the picture. */
  protected get scale(): number {
    const size = this.size;
    if (this.zoom || !size) return this.zoom || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const parts = this.mode === "repeat" ? 2.5 : 1;
    const margin = this.mode === "repeat" || this.look ? 0 : 32;
    const fit = Math.min(
      (clientWidth - margin) / size.width,
      (clientHeight - margin) / size.height,
    );
    return Math.max(0.01, fit / parts);
  }

  /** The least `scale` that zooming reaches. */
  protected get smallest(): number {
    return 0.02;
  }

  /** The part of the picture that is in view, px. */
  get window(): { top: number; left: number; height: number; width: number } {
    const [height, width] = [this.canvas.clientHeight / this.scale, this.canvas.clientWidth / this.scale].map(Math.round);
    const { x, y } = this.center;
    return { top: Math.round(y * this.size!.height - height / 2), left: Math.round(x * this.size!.width - width / 2), height, width };
  }

  draw(): void {
    const { canvas } = this;
    if (!canvas) return;
    const ratio = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d")!;
    const size = this.size;
    if (!size) return;
    context.scale(ratio, ratio);
    const scale = this.scale;
    context.imageSmoothingEnabled = this.isReduced || scale < 3;
    context.imageSmoothingQuality = "high";
    const left = width / 2 - this.center.x * size.width * scale;
    const top = height / 2 - this.center.y * size.height * scale;
    this.drawContent(context, left, top, scale, width, height);
    this.over?.(context, ({ x, y }) => [left + x * scale, top + y * scale], scale);
    if (this.mode === "single") this.drawMarks(context, left, top, scale);
    if (this.mode === "compare" && this.exemplar) this.drawExemplar(context, left, top, scale, width, height);
  }

  protected drawMarks(context: CanvasRenderingContext2D, left: number, top: number, scale: number): void {
    if (this.patch) {
      const { picture, x, y } = this.patch;
      context.drawImage(picture, left + x * scale, top + y * scale, picture.width * scale, picture.height * scale);
    }
    const at = ({ x, y }: Point): [number, number] => [left + (x + 0.5) * scale, top + (y + 0.5) * scale];
    const stroke = (path: Path2D) => {
      for (const [style, width] of [["rgb(0 0 0 / 0.6)", 4], ["#fff", 1.6]] as const) {
        context.strokeStyle = style;
        context.lineWidth = width;
        context.stroke(path);
      }
    };
    const line = this.isDrawing ? this.drawn : this.outline;
    if (line.length > 1) {
      const path = new Path2D();
      line.forEach((point, index) => (index ? path.lineTo(...at(point)) : path.moveTo(...at(point))));
      if (!this.isDrawing) path.closePath();
      stroke(path);
    }
    [context.font, context.textAlign, context.textBaseline] = ["600 10px system-ui", "center", "middle"];
    this.marks.forEach((mark, index) => {
      const path = new Path2D();
      path.arc(...at(mark), 9, 0, 2 * Math.PI);
      context.fillStyle = "rgb(0 0 0 / 0.45)";
      context.fill(path);
      stroke(path);
      context.fillStyle = "#fff";
      context.fillText(String(index + 1), ...at(mark));
    });
  }

  /** The place of the picture under a place of the window. */
  private place(event: PointerEvent): Point {
    const box = this.canvas.getBoundingClientRect();
    const scale = this.scale;
    const { width, height } = this.size!;
    return {
      x: (event.clientX - box.left - box.width / 2) / scale + this.center.x * width,
      y: (event.clientY - box.top - box.height / 2) / scale + this.center.y * height,
    };
  }

  private pixel(event: PointerEvent): Point {
    const { x, y } = this.place(event);
    return { x: Math.floor(x), y: Math.floor(y) };
  }

  protected drawContent(
    context: CanvasRenderingContext2D, left: number, top: number, scale: number, width: number, height: number,
  ): void {
    const [picture, size] = [this.picture, this.size!];
    if (!picture) {
      context.fillStyle = getComputedStyle(this).getPropertyValue("--panel");
      context.fillRect(left, top, size.width * scale, size.height * scale);
      return;
    }
    if (this.mode !== "repeat") {
      context.drawImage(picture, left, top, size.width * scale, size.height * scale);
      return;
    }
    const pattern = context.createPattern(picture, "repeat")!;
    pattern.setTransform(new DOMMatrix([scale, 0, 0, scale, left, top]));
    context.fillStyle = pattern;
    context.fillRect(0, 0, width, height);
  }

  private drawExemplar(
    context: CanvasRenderingContext2D, left: number, top: number, scale: number, width: number, height: number,
  ): void {
    const exemplar = this.exemplar!;
    const edge = this.split * width;
    const size = scale * this.exemplarScale;
    context.save();
    context.beginPath();
    context.rect(0, 0, edge, height);
    context.clip();
    context.fillStyle = getComputedStyle(this).getPropertyValue("--canvas");
    context.fillRect(0, 0, edge, height);
    context.drawImage(exemplar, left, top, exemplar.width * size, exemplar.height * size);
    context.restore();
    context.fillStyle = getComputedStyle(this).getPropertyValue("--accent");
    context.fillRect(edge - 1, 0, 2, height);
    context.beginPath();
    context.arc(edge, height / 2, 9, 0, 2 * Math.PI);
    context.fill();
  }

  // -- hands and keys

  protected down(event: PointerEvent): void {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const edge = this.canvas.getBoundingClientRect().left + this.split * this.canvas.clientWidth;
    const isTool = this.pointers.size === 1 && this.mode === "single" && event.button !== 1 && !event.altKey;
    if (!isTool) this.release("cancel"); // a second finger zooms
    this.isDrawing = isTool && this.tool === "lasso" && event.button === 0;
    if (this.isDrawing && this.picture) {
      this.drawn = [this.pixel(event)];
      this.draw();
      return;
    }
    this.isActing = isTool && this.tool === "act" && this.size !== null;
    if (this.isActing) {
      this.act("begin", this.place(event), event.button === 2 || event.button === 5, event.detail > 1);
      return;
    }
    this.isSplitting = this.mode === "compare" && Math.abs(event.clientX - edge) < 16;
  }

  protected move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (!this.size) return;
    if (!before) {
      if (this.tool === "act") this.act("hover", this.place(event));
      else if (this.mode === "single") this.tell("hover", this.pixel(event));
      return;
    }
    if (this.isDrawing) {
      this.drawn.push(this.pixel(event));
      this.draw();
      return;
    }
    if (this.isActing) {
      for (const one of event.getCoalescedEvents?.() ?? []) this.act("drag", this.place(one));
      this.act("drag", this.place(event));
      return;
    }
    const now = { x: event.clientX, y: event.clientY };
    if (this.isSplitting) {
      this.moveSplit((now.x - this.canvas.getBoundingClientRect().left) / this.canvas.clientWidth);
      return;
    }
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    if (others.length) {
      const apart = (at: { x: number; y: number }) => Math.hypot(at.x - others[0].x, at.y - others[0].y);
      this.zoomBy(apart(now) / Math.max(1, apart(before)), others[0].x, others[0].y);
    } else {
      this.pan(now.x - before.x, now.y - before.y);
    }
    this.pointers.set(event.pointerId, now);
  }

  protected up(event: PointerEvent): void {
    this.pointers.delete(event.pointerId);
    this.release(event.type === "pointercancel" ? "cancel" : "end");
    if (this.isDrawing) {
      this.isDrawing = false;
      this.draw();
      if (this.drawn.length > 2) this.tell("lasso", this.drawn);
    }
    this.isSplitting = false;
  }

  private leave(): void {
    if (this.tool === "act") this.act("leave", { x: -1, y: -1 });
    else this.tell("hover", null);
  }

  private act(phase: Act["phase"], { x, y }: Point, isOther = false, isDouble = false): void {
    this.cursor = phase === "leave" ? null : { x, y };
    this.tell<Act>("act", { phase, x, y, scale: this.scale, isOther, isDouble });
  }

  /** End what the tool does. */
  private release(phase: "end" | "cancel"): void {
    if (this.isActing) this.act(phase, this.cursor!);
    this.isActing = false;
    if (phase === "end" || !this.isDrawing) return;
    this.isDrawing = false;
    this.draw();
  }

  /** Move or use the tool by a key; whether it was one of these. */
  private actByKey(event: KeyboardEvent): boolean {
    const { width, height } = this.size!;
    const at = this.cursor ?? { x: width / 2, y: height / 2 };
    if (event.key === " ") {
      if (!this.isActing) this.act("begin", at);
      this.isActing = true;
      return true;
    }
    const step = STEPS[event.key];
    if (!step || !event.shiftKey) return false;
    const move = KEY_STEP / this.scale;
    const to = { x: Math.min(width, Math.max(0, at.x + step[0] * move)), y: Math.min(height, Math.max(0, at.y + step[1] * move)) };
    this.act(this.isActing ? "drag" : "hover", to);
    return true;
  }

  private moveSplit(share: number): void {
    this.split = Math.min(0.98, Math.max(0.02, share));
    this.draw();
  }

  private pan(x: number, y: number): void {
    const size = this.size;
    if (!size) return;
    const scale = this.scale;
    this.zoom = scale;
    this.center.x -= x / (size.width * scale);
    this.center.y -= y / (size.height * scale);
    this.moved();
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.zoomBy(ZOOM_STEP ** (-event.deltaY / 100), event.clientX, event.clientY);
  }

  /** Zoom about a place of the window. */
  private zoomBy(factor: number, x: number, y: number): void {
    const size = this.size;
    if (!size) return;
    const box = this.canvas.getBoundingClientRect();
    const [right, down] = [x - box.left - box.width / 2, y - box.top - box.height / 2];
    const before = this.scale;
    this.zoom = Math.min(LARGEST, Math.max(Math.min(this.smallest, before), before * factor));
    const change = 1 / before - 1 / this.zoom;
    this.center.x += (right * change) / size.width;
    this.center.y += (down * change) / size.height;
    this.moved();
  }

  protected key(event: KeyboardEvent): void {
    if (this.tool === "act" && this.size && this.actByKey(event)) {
      event.preventDefault();
      return;
    }
    const box = this.canvas.getBoundingClientRect();
    const middle: [number, number] = [box.left + box.width / 2, box.top + box.height / 2];
    const isSplit = this.mode === "compare" && event.shiftKey;
    const actions: Record<string, () => void> = {
      "+": () => this.zoomBy(ZOOM_STEP, ...middle),
      "=": () => this.zoomBy(ZOOM_STEP, ...middle),
      "-": () => this.zoomBy(1 / ZOOM_STEP, ...middle),
      "0": () => this.fit(),
      ArrowLeft: () => (isSplit ? this.moveSplit(this.split - 0.02) : this.pan(PAN_STEP, 0)),
      ArrowRight: () => (isSplit ? this.moveSplit(this.split + 0.02) : this.pan(-PAN_STEP, 0)),
      ArrowUp: () => this.pan(0, PAN_STEP),
      ArrowDown: () => this.pan(0, -PAN_STEP),
    };
    const action = actions[event.key];
    if (action) {
      event.preventDefault();
      action();
    }
  }
}
