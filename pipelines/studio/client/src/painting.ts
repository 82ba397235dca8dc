// Layers that are painted, with one history of all of them.
import { type Area, joined } from "./control-map";
import type { Point } from "./picture-view";

const MOST_BYTES = 2 ** 27; // of the history; the oldest changes are forgotten
type Rgba = [number, number, number, number];

export class Layer {
  readonly context: CanvasRenderingContext2D;

  constructor(
    readonly width: number,
    readonly height: number,
  ) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [width, height];
    this.context = canvas.getContext("2d", { willReadFrequently: true })!;
  }

  get canvas(): HTMLCanvasElement {
    return this.context.canvas;
  }

  get whole(): Area {
    return { top: 0, left: 0, height: this.height, width: this.width };
  }

  read({ left, top, width, height }: Area): ImageData {
    return this.context.getImageData(left, top, width, height);
  }

  get isEmpty(): boolean {
    const { data } = this.read(this.whole);
    for (let index = 3; index < data.length; index += 4) if (data[index]) return false;
    return true;
  }

  /** A line of round ends; without a colour it erases. */
  line(from: Point, to: Point, radius: number, color: string | null): Area {
    const { context } = this;
    context.globalCompositeOperation = color === null ? "destination-out" : "source-over";
    [context.strokeStyle, context.lineWidth, context.lineCap] = [color ?? "#000", 2 * radius, "round"];
    context.beginPath();
    context.moveTo(from.x, from.y);
    context.lineTo(to.x, to.y);
    context.stroke();
    context.globalCompositeOperation = "source-over";
    return this.inside(
      Math.min(from.x, to.x) - radius - 1, Math.min(from.y, to.y) - radius - 1,
      Math.max(from.x, to.x) + radius + 1, Math.max(from.y, to.y) + radius + 1,
    );
  }

  /** Colour, or erase, what is chosen. */
  flood(chosen: Uint8Array, color: Rgba): Area {
    const image = this.read(this.whole);
    chosen.forEach((is, index) => is && image.data.set(color, 4 * index));
    this.context.putImageData(image, 0, 0);
    return this.whole;
  }

  private inside(left: number, top: number, right: number, bottom: number): Area {
    const clip = (value: number, most: number): number => Math.min(most, Math.max(0, value));
    const [x, y] = [clip(Math.floor(left), this.width), clip(Math.floor(top), this.height)];
    return { left: x, top: y, width: clip(Math.ceil(right), this.width) - x, height: clip(Math.ceil(bottom), this.height) - y };
  }
}

interface Change {
  layer: Layer;
  area: Area;
  before: ImageData;
  after: ImageData;
}

/** The history of some layers. */
export class Changes {
  private past: Change[] = [];
  private future: Change[] = [];
  private current: { layer: Layer; before: Layer; area: Area | null } | null = null;

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  /** Remember a layer before it changes. */
  begin(layer: Layer): void {
    const before = new Layer(layer.width, layer.height);
    before.context.drawImage(layer.canvas, 0, 0);
    this.current = { layer, before, area: null };
  }

  touched(area: Area): void {
    if (this.current && area.width > 0 && area.height > 0) this.current.area = joined(this.current.area, area);
  }

  /** Keep what has changed since `begin`; whether there is anything. */
  end(): boolean {
    const { layer, before, area } = this.current ?? { area: null };
    this.current = null;
    if (!area || !layer || !before) return false;
    this.past.push({ layer, area, before: before.read(area), after: layer.read(area) });
    this.future = [];
    const bytes = (): number => this.past.reduce((sum, one) => sum + 2 * one.before.data.length, 0);
    while (this.past.length > 1 && bytes() > MOST_BYTES) this.past.shift();
    return true;
  }

  cancel(): void {
    const { layer, before } = this.current ?? {};
    this.current = null;
    if (!layer || !before) return;
    layer.context.clearRect(0, 0, layer.width, layer.height);
    layer.context.drawImage(before.canvas, 0, 0);
  }

  undo(): void {
    const change = this.past.pop();
    if (!change) return;
    change.layer.context.putImageData(change.before, change.area.left, change.area.top);
    this.future.push(change);
  }

  redo(): void {
    const change = this.future.pop();
    if (!change) return;
    change.layer.context.putImageData(change.after, change.area.left, change.area.top);
    this.past.push(change);
  }
}

/** The pixels that are connected with one and whose colours differ little from its own, by 0 to 255 a channel: 1. */
export function connected(image: ImageData, at: Point, tolerance: number): Uint8Array {
  const { width, height, data } = image;
  const chosen = new Uint8Array(width * height);
  const first = Math.floor(at.y) * width + Math.floor(at.x);
  const like = (index: number): boolean => {
    for (let channel = 0; channel < 4; channel += 1) {
      if (Math.abs(data[4 * index + channel] - data[4 * first + channel]) > tolerance) return false;
    }
    return true;
  };
  const waiting = [first];
  while (waiting.length) {
    const index = waiting.pop()!;
    if (chosen[index] || !like(index)) continue;
    chosen[index] = 1;
    const column = index % width;
    if (column > 0) waiting.push(index - 1);
    if (column < width - 1) waiting.push(index + 1);
    if (index >= width) waiting.push(index - width);
    if (index < width * (height - 1)) waiting.push(index + width);
  }
  return chosen;
}

/** A layer in one colour over another, or over nothing. */
export function flattened(layer: Layer, over: string | null, color: string | null): HTMLCanvasElement {
  const { context } = new Layer(layer.width, layer.height);
  context.drawImage(layer.canvas, 0, 0);
  if (color) {
    context.globalCompositeOperation = "source-in";
    context.fillStyle = color;
    context.fillRect(0, 0, layer.width, layer.height);
  }
  if (over) {
    context.globalCompositeOperation = "destination-over";
    context.fillStyle = over;
    context.fillRect(0, 0, layer.width, layer.height);
  }
  return context.canvas;
}
