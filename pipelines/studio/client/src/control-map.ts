// A grey map that is painted, 8 bits a pixel, with undo of whole strokes.
import { Undo } from "./undo";

export interface Area {
  top: number;
  left: number;
  height: number;
  width: number;
}

type Picture = ImageBitmap | HTMLImageElement | HTMLCanvasElement;

const NOTHING: Area = { top: 0, left: 0, height: 0, width: 0 };

export class ControlMap {
  codes: Uint8Array;
  private readonly history: Undo<Uint8Array>;

  /** A map that is like a picture, stretched to its size; or one that rises from left to right. */
  constructor(
    readonly height: number,
    readonly width: number,
    begun?: Picture,
  ) {
    this.codes = new Uint8Array(height * width);
    if (begun) this.draw(begun);
    else this.codes.forEach((_, index) => (this.codes[index] = Math.round((255 * (index % width)) / (width - 1))));
    this.history = new Undo(this.codes.slice());
  }

  get canUndo(): boolean {
    return this.history.canUndo;
  }

  get canRedo(): boolean {
    return this.history.canRedo;
  }

  /** Draw a soft dab; the area that it changes. */
  dab(x: number, y: number, radius: number, code: number, hardness: number): Area {
    const top = Math.max(0, Math.ceil(y - radius));
    const left = Math.max(0, Math.ceil(x - radius));
    const bottom = Math.min(this.height, Math.floor(y + radius) + 1);
    const right = Math.min(this.width, Math.floor(x + radius) + 1);
    if (bottom <= top || right <= left) return NOTHING;
    for (let row = top; row < bottom; row += 1) {
      for (let column = left; column < right; column += 1) {
        const away = Math.hypot(row - y, column - x) / radius;
        const share = Math.min(1, Math.max(0, (1 - away) / Math.max(0.01, 1 - hardness)));
        const index = row * this.width + column;
        this.codes[index] = Math.round(this.codes[index] + share * (code - this.codes[index]));
      }
    }
    return { top, left, height: bottom - top, width: right - left };
  }

  /** Take a picture of a map, stretched to this one. */
  load(picture: Picture): void {
    this.draw(picture);
    this.keep();
  }

  private draw(picture: Picture): void {
    const context = this.context();
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, 0, 0, this.width, this.height);
    const pixels = context.getImageData(0, 0, this.width, this.height).data;
    this.codes = this.codes.map((_, index) => pixels[4 * index]);
  }

  fill(code: number): void {
    this.codes.fill(code);
    this.keep();
  }

  /** Replace all of it. */
  take(codes: Uint8Array): void {
    this.codes.set(codes);
  }

  /** End a stroke, which undo takes back. */
  keep(): void {
    this.history.set(this.codes.slice());
  }

  step(direction: "undo" | "redo"): void {
    this.history[direction]();
    this.codes = this.history.now.slice();
  }

  get whole(): Area {
    return { top: 0, left: 0, height: this.height, width: this.width };
  }

  part({ top, left, height, width }: Area): Uint8Array {
    const part = new Uint8Array(height * width);
    for (let row = 0; row < height; row += 1) {
      const begin = (top + row) * this.width + left;
      part.set(this.codes.subarray(begin, begin + width), row * width);
    }
    return part;
  }

  /** The codes of a smaller map. */
  reduced(side: number): Uint8Array {
    return side === this.width ? this.codes : new ControlMap(side, side, this.canvas()).codes;
  }

  /** The map as a picture. */
  canvas(): HTMLCanvasElement {
    const context = this.context();
    const image = context.createImageData(this.width, this.height);
    this.codes.forEach((code, index) => image.data.set([code, code, code, 255], 4 * index));
    context.putImageData(image, 0, 0);
    return context.canvas;
  }

  /** The address of a picture of the map at a size. */
  address(side: number): string {
    const map = side === this.width ? this : new ControlMap(side, side, this.canvas());
    return map.canvas().toDataURL("image/png");
  }

  private context(): CanvasRenderingContext2D {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [this.width, this.height];
    return canvas.getContext("2d", { willReadFrequently: true })!;
  }
}

/** The smallest area that holds both. */
export function joined(one: Area | null, other: Area): Area {
  if (!one || !one.height) return other;
  if (!other.height) return one;
  const [top, left] = [Math.min(one.top, other.top), Math.min(one.left, other.left)];
  const bottom = Math.max(one.top + one.height, other.top + other.height);
  const right = Math.max(one.left + one.width, other.left + other.width);
  return { top, left, height: bottom - top, width: right - left };
}

/** The picture at an address. */
export async function decoded(address: string): Promise<HTMLImageElement> {
  const picture = new Image();
  picture.src = address;
  await picture.decode();
  return picture;
}
