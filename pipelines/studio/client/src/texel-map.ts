// Values painted on a surface, at the pixels of its texture; a dab reaches across the borders of charts.
import { decoded } from "./control-map";
import { type Corners, VALUES } from "./corners";

const GROWN = 3; // px by which charts are continued

export class TexelMap {
  readonly canvas = document.createElement("canvas");
  readonly codes: Uint8Array;
  private readonly places: Float32Array; // three values a pixel; NaN where there is no surface

  constructor(
    corners: Corners,
    readonly side: number,
    code: number,
  ) {
    this.places = new Float32Array(3 * side * side).fill(NaN);
    this.codes = new Uint8Array(side * side).fill(code);
    for (let face = 0; face < corners.length; face += 3 * VALUES) this.cover(corners, face);
    for (let round = 0; round < GROWN; round += 1) this.grow();
    [this.canvas.width, this.canvas.height] = [side, side];
    this.draw();
  }

  /** The positions of the pixels inside a face. */
  private cover(corners: Corners, face: number): void {
    const { side, places } = this;
    const at = (corner: number): [number, number] => [
      corners[face + corner * VALUES + 6] * side - 0.5, (1 - corners[face + corner * VALUES + 7]) * side - 0.5,
    ];
    const [a, b, c] = [at(0), at(1), at(2)];
    const area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if (!area) return;
    const range = (axis: 0 | 1): [number, number] => [
      Math.max(0, Math.ceil(Math.min(a[axis], b[axis], c[axis]))), Math.min(side - 1, Math.floor(Math.max(a[axis], b[axis], c[axis]))),
    ];
    const [[left, right], [top, bottom]] = [range(0), range(1)];
    for (let y = top; y <= bottom; y += 1) {
      for (let x = left; x <= right; x += 1) {
        const second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area;
        const third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area;
        if (second < 0 || third < 0 || second + third > 1) continue;
        for (let axis = 0; axis < 3; axis += 1) {
          const [p, q, r] = [0, 1, 2].map((corner) => corners[face + corner * VALUES + axis]);
          places[3 * (y * side + x) + axis] = p + second * (q - p) + third * (r - p);
        }
      }
    }
  }

  /** Continue charts by a pixel, so that filters find no border. */
  private grow(): void {
    const { side } = this;
    const before = this.places.slice();
    for (let index = 0; index < side * side; index += 1) {
      if (!Number.isNaN(before[3 * index])) continue;
      const near = [index - 1, index + 1, index - side, index + side].find((one) => !Number.isNaN(before[3 * one] ?? NaN));
      if (near !== undefined) this.places.set(before.subarray(3 * near, 3 * near + 3), 3 * index);
    }
  }

  /** Give a value to everything within a distance of a point. */
  dab(point: readonly number[], radius: number, code: number): void {
    const { places, codes } = this;
    for (let index = 0; index < codes.length; index += 1) {
      const [x, y, z] = [places[3 * index] - point[0], places[3 * index + 1] - point[1], places[3 * index + 2] - point[2]];
      if (x * x + y * y + z * z < radius * radius) codes[index] = code;
    }
    this.draw();
  }

  restore(codes: Uint8Array): void {
    this.codes.set(codes);
    this.draw();
  }

  /** The values as the address of a picture. */
  get address(): string {
    return this.canvas.toDataURL("image/png");
  }

  /** The values that a picture has at an address. */
  async load(address: string): Promise<Uint8Array> {
    const picture = await decoded(address);
    const context = new OffscreenCanvas(this.side, this.side).getContext("2d")!;
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, this.side, this.side);
    return this.codes.map((_, index) => data[4 * index]);
  }

  private draw(): void {
    const context = this.canvas.getContext("2d", { willReadFrequently: true })!;
    const image = context.createImageData(this.side, this.side);
    this.codes.forEach((code, index) => {
      image.data[4 * index] = image.data[4 * index + 1] = image.data[4 * index + 2] = code;
      image.data[4 * index + 3] = 255;
    });
    context.putImageData(image, 0, 0);
  }
}
