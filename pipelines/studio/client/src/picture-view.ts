// A picture to look at: panned and zoomed by hand or keys, and drawn in.
import { html, type TemplateResult } from "lit";
import { customElement } from "lit/decorators.js";
import { type Act, PictureCanvas, type Point } from "./picture-canvas";

export * from "./picture-canvas";

const ZOOM_STEP = 1.2;
const LARGEST = 32; // screen pixels of a pixel
const PAN_STEP = 48; // px of an arrow key
const KEY_STEP = 12; // screen pixels that a key moves a tool
const STEPS: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

@customElement("picture-view")
export class PictureView extends PictureCanvas {
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private isSplitting = false;
  private isActing = false;
  private cursor: Point | null = null; // moved by keys

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
