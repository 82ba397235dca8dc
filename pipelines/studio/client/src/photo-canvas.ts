// A photograph with patches to drag and areas to paint.
import { customElement, property } from "lit/decorators.js";
import { border, lineOf, type Spot, surface } from "./bezier";
import type { BrushRecipe, PatchRecipe, PhotoPatch, Picture } from "./messages";
import { changed, EMPTY, type Handle, handlesOf, moved, painted, type PhotoDocument, placeOf, thinned } from "./photo-document";
import { PictureView } from "./picture-view";

export type Shown = { plain: Float32Array; lines: number; points: number };
export type Brush = Pick<BrushRecipe, "tool" | "erase" | "radius" | "tolerance" | "features">;
/** what a hand has done: `isFinal` when it has been lifted */
export interface Edit {
  document: PhotoDocument;
  isFinal: boolean;
}

const REACH = 14; // screen px around a handle
const KEY_STEP = 1; // px of the photograph; ten times that with Shift
const DOWN = "#ff6b5e";
const ACROSS = "#5fd38a";
const SELECTED = "#fff";
export const AREA_COLORS: Record<string, [number, number, number]> = {
  region: [63, 190, 180], without: [224, 96, 84], hole: [250, 250, 250], features: [240, 200, 70],
};

/** Tells `edit` with an `Edit`, and `select` with the name of a patch or a handle. */
@customElement("photo-canvas")
export class PhotoCanvas extends PictureView {
  @property({ attribute: false }) photo!: Picture;
  @property({ attribute: false }) document: PhotoDocument = EMPTY;
  @property({ attribute: false }) described: ReadonlyMap<string, PhotoPatch> = new Map();
  @property({ attribute: false }) areas: ReadonlyMap<string, HTMLCanvasElement> = new Map();
  @property({ attribute: false }) streamlines: Shown | null = null;
  @property() patchName = "";
  @property({ type: Boolean }) isCurved = false;
  @property({ type: Boolean }) hasGrid = true;
  /** the area that is painted; empty: patches are dragged */
  @property() area = "";
  @property({ attribute: false }) brush: Brush = { tool: "stroke" };
  @property({ attribute: false }) handle: Handle | null = null;
  private grabbed = false;
  /** the hand that drags a handle or paints, and what it may still take back */
  private first: { event: PointerEvent; before: PhotoDocument } | null = null;
  private stroke: Spot[] = [];
  private pointer: Spot | null = null;
  private origin = { left: 0, top: 0, scale: 1 };

  private get patchOf(): PatchRecipe | undefined {
    return this.document.patches.find((patch) => patch.name === this.patchName);
  }

  // -- places
  /** Screen px of a px of the photograph. */
  private get unit(): number {
    return (this.scale * this.size!.width) / this.photo.width;
  }

  private onScreen([row, column]: Spot): [number, number] {
    const { left, top } = this.origin;
    return [left + (column + 0.5) * this.unit, top + (row + 0.5) * this.unit];
  }

  private spot(event: PointerEvent): Spot {
    const box = this.canvas.getBoundingClientRect();
    const { left, top } = this.origin;
    return [(event.clientY - box.top - top) / this.unit - 0.5, (event.clientX - box.left - left) / this.unit - 0.5];
  }

  private path(points: readonly Spot[], isClosed = false): Path2D {
    const path = new Path2D();
    points.forEach((point, index) => {
      const at = this.onScreen(point);
      if (index) path.lineTo(...at);
      else path.moveTo(...at);
    });
    if (isClosed) path.closePath();
    return path;
  }

  // -- drawing

  protected override drawMarks(context: CanvasRenderingContext2D, left: number, top: number, scale: number): void {
    this.origin = { left, top, scale };
    const { width, height } = this.size!;
    for (const area of this.areas.values()) context.drawImage(area, left, top, width * scale, height * scale);
    for (const patch of this.document.patches) this.drawPatch(context, patch);
    if (this.streamlines && !this.grabbed) this.drawStreamlines(context, this.streamlines);
    if (this.area) this.drawBrush(context);
    else if (this.patchOf) this.drawHandles(context, this.patchOf);
  }

  private drawPatch(context: CanvasRenderingContext2D, patch: PatchRecipe): void {
    const told = this.described.get(patch.name);
    const isSelected = patch.name === this.patchName;
    if (this.hasGrid && told && !told.problem) {
      const shape = surface(patch);
      context.lineWidth = 1;
      context.globalAlpha = isSelected ? 0.9 : 0.5;
      for (const [at, isDown, color] of [
        ...told.columns.map((v) => [v, true, DOWN] as const), ...told.rows.map((u) => [u, false, ACROSS] as const),
      ]) {
        context.strokeStyle = color;
        context.stroke(this.path(lineOf(shape, at, isDown)));
      }
      context.globalAlpha = 1;
    }
    // An invalid plane has no surface to draw.
    const outline = told?.problem && patch.corners ? patch.corners : border(surface(patch));
    this.twice(context, this.path(outline, true), told?.problem ? "#ff5a4d" : isSelected ? SELECTED : "#c8ccd0");
    if (told?.problem) this.words(context, patch, told.problem.replace(/^patch '[^']*': /, ""));
  }

  private twice(context: CanvasRenderingContext2D, path: Path2D, color: string, width = 1.6): void {
    for (const [style, line] of [["rgb(0 0 0 / 0.55)", width + 2], [color, width]] as const) {
      [context.strokeStyle, context.lineWidth] = [style, line];
      context.stroke(path);
    }
  }

  /** Words at a patch. */
  private words(context: CanvasRenderingContext2D, patch: PatchRecipe, text: string): void {
    context.font = "12px system-ui, sans-serif";
    const width = context.measureText(text).width + 16;
    const [x, y] = this.onScreen(placeOf(patch, { kind: "whole" }));
    const left = Math.min(Math.max(8, x - width / 2), this.canvas.clientWidth - width - 8);
    const top = Math.min(Math.max(8, y + 16), this.canvas.clientHeight - 32);
    context.fillStyle = "#7d2019";
    context.beginPath();
    context.roundRect(left, top, width, 24, 5);
    context.fill();
    context.fillStyle = "#fff";
    context.fillText(text, left + 8, top + 16);
  }

  private drawStreamlines(context: CanvasRenderingContext2D, { plain, lines, points }: Shown): void {
    for (const [direction, color] of [DOWN, ACROSS].entries()) {
      const path = new Path2D();
      for (let line = 0; line < lines; line += 1) {
        for (let point = 0; point < points; point += 1) {
          const index = 2 * ((direction * lines + line) * points + point);
          const at = this.onScreen([plain[index], plain[index + 1]]);
          if (point) path.lineTo(...at);
          else path.moveTo(...at);
        }
      }
      this.twice(context, path, color, 1.2);
    }
  }

  private drawHandles(context: CanvasRenderingContext2D, patch: PatchRecipe): void {
    if (this.isCurved) {
      const { controls } = surface(patch);
      context.globalAlpha = 0.6;
      for (const points of controls) this.twice(context, this.path(points), "#8ec5ff", 1);
      for (const j of [0, 1, 2, 3]) this.twice(context, this.path(controls.map((points) => points[j])), "#8ec5ff", 1);
      context.globalAlpha = 1;
    }
    for (const handle of handlesOf(this.isCurved)) {
      const path = new Path2D();
      path.arc(...this.onScreen(placeOf(patch, handle)), handle.kind === "control" ? 5 : 7, 0, 2 * Math.PI);
      const isChosen = JSON.stringify(handle) === JSON.stringify(this.handle);
      context.fillStyle = isChosen ? "#3f9c95" : handle.kind === "whole" ? "rgb(0 0 0 / 0.35)" : "rgb(255 255 255 / 0.35)";
      context.fill(path);
      this.twice(context, path, SELECTED);
    }
  }

  private drawBrush(context: CanvasRenderingContext2D): void {
    const [red, green, blue] = AREA_COLORS[this.area.split(".")[0]];
    const color = this.brush.erase ? "0 0 0" : `${red} ${green} ${blue}`;
    if (this.stroke.length && this.brush.tool === "stroke") {
      context.lineCap = context.lineJoin = "round";
      context.strokeStyle = `rgb(${color} / 0.5)`;
      context.lineWidth = 2 * this.brush.radius! * this.unit;
      context.stroke(this.path([...this.stroke, this.stroke.at(-1)!]));
    } else if (this.stroke.length) {
      this.twice(context, this.path(this.stroke), SELECTED);
    }
    if (this.pointer && this.brush.tool === "stroke") {
      const path = new Path2D();
      path.arc(...this.onScreen(this.pointer), Math.max(1, this.brush.radius! * this.unit), 0, 2 * Math.PI);
      this.twice(context, path, SELECTED, 1.2);
    }
  }

  // -- hands and keys

  protected override down(event: PointerEvent): void {
    if (!this.picture || event.button !== 0 || event.altKey) {
      super.down(event);
      return;
    }
    if (this.first) {
      this.zoomInstead(this.first, event);
      return;
    }
    const spot = this.spot(event);
    if (this.area) {
      this.canvas.setPointerCapture(event.pointerId);
      this.first = { event, before: this.document };
      this.stroke = [spot];
      this.draw();
      return;
    }
    const patch = this.patchOf;
    const near = patch && handlesOf(this.isCurved).find((handle) => this.isNear(event, placeOf(patch, handle)));
    if (near) {
      this.canvas.setPointerCapture(event.pointerId);
      this.first = { event, before: this.document };
      [this.handle, this.grabbed] = [near, true];
      this.tell("handle", near);
      return;
    }
    const other = this.document.patches.find((one) => one.name !== this.patchName && this.isInside(event, one));
    if (other) this.tell("select", other.name);
    super.down(event);
  }

  /** A second finger zooms; what the first has done is taken back. */
  private zoomInstead({ event, before }: { event: PointerEvent; before: PhotoDocument }, second: PointerEvent): void {
    if (this.grabbed) {
      this.document = before;
      this.tell<Edit>("edit", { document: before, isFinal: false });
    }
    [this.first, this.grabbed, this.stroke] = [null, false, []];
    super.down(event);
    super.down(second);
  }

  private isNear(event: PointerEvent, place: Spot): boolean {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = this.onScreen(place);
    return Math.hypot(event.clientX - box.left - x, event.clientY - box.top - y) < REACH;
  }

  private isInside(event: PointerEvent, patch: PatchRecipe): boolean {
    const box = this.canvas.getBoundingClientRect();
    const outline = this.path(border(surface(patch)), true);
    const context = new OffscreenCanvas(1, 1).getContext("2d")!;
    return context.isPointInPath(outline, event.clientX - box.left, event.clientY - box.top);
  }

  protected override move(event: PointerEvent): void {
    if (!this.picture) return;
    this.pointer = this.spot(event);
    if (this.grabbed) {
      this.drag(this.pointer, false);
    } else if (this.stroke.length) {
      this.stroke = [...this.stroke, this.pointer];
      this.draw();
    } else {
      super.move(event);
      if (this.area) this.draw();
    }
  }

  private drag(to: Spot, isFinal: boolean): void {
    const document = changed(this.document, this.patchName, (patch) => moved(patch, this.handle!, to));
    this.document = document;
    this.draw(); // at once; the rest follows when the server has answered
    this.tell<Edit>("edit", { document, isFinal });
  }

  protected override up(event: PointerEvent): void {
    super.up(event);
    this.first = null;
    if (this.grabbed) {
      this.grabbed = false;
      this.tell<Edit>("edit", { document: this.document, isFinal: true });
    } else if (this.stroke.length) {
      const points = thinned(this.stroke, this.brush);
      this.stroke = [];
      if (points.length >= (this.brush.tool === "outline" ? 3 : 1)) {
        this.tell<Edit>("edit", { document: painted(this.document, this.area, { ...this.brush, points }), isFinal: true });
      }
    }
    this.draw();
  }

  protected override key(event: KeyboardEvent): void {
    const patch = this.patchOf;
    const offset = ({ ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] } as Record<string, Spot>)[event.key];
    if (patch && !this.area && (event.key === "[" || event.key === "]")) {
      const handles = handlesOf(this.isCurved);
      const before = handles.findIndex((one) => JSON.stringify(one) === JSON.stringify(this.handle));
      this.handle = handles[(Math.max(before, 0) + (event.key === "]" ? 1 : handles.length - 1)) % handles.length];
      this.tell("handle", this.handle);
    } else if (patch && !this.area && this.handle && offset) {
      event.preventDefault();
      const step = KEY_STEP * (event.shiftKey ? 10 : 1);
      const [row, column] = placeOf(patch, this.handle);
      this.drag([row + step * offset[0], column + step * offset[1]], true);
    } else if (event.key === "Escape" && this.handle) {
      this.handle = null;
      this.tell("handle", null);
    } else {
      super.key(event);
    }
  }
}
