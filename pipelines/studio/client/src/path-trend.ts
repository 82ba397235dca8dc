// A trend along a drawn way, as `stages/common/grids/path_trend.py` lays it: black where it begins, white where it ends.
import type { Point } from "./picture-view";

const WHITE = 255;
const SMOOTH = 1 / 32; // of the longer side: radius within which steps between parts of the way are softened
const PASSES = 3;

/** How far along a way the nearest point of each pixel is, 0 to 255; null where all its points are one. */
export function alongWay(way: readonly Point[], height: number, width: number): Uint8Array | null {
  const lengths = way.slice(1).map((to, index) => Math.hypot(to.x - way[index].x, to.y - way[index].y));
  const whole = lengths.reduce((sum, one) => sum + one, 0);
  if (!whole) return null;
  const found = new Float32Array(height * width);
  for (let row = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1) {
      let [nearest, before] = [Infinity, 0];
      lengths.forEach((length, index) => {
        if (!length) return;
        const [from, to] = [way[index], way[index + 1]];
        const [x, y] = [column + 0.5 - from.x, row + 0.5 - from.y];
        const [across, down] = [(to.x - from.x) / length, (to.y - from.y) / length];
        const along = Math.min(length, Math.max(0, x * across + y * down));
        const away = (x - along * across) ** 2 + (y - along * down) ** 2;
        if (away < nearest) {
          nearest = away;
          found[row * width + column] = (before + along) / whole;
        }
        before += length;
      });
    }
  }
  const radius = Math.max(1, Math.round(SMOOTH * Math.max(height, width)));
  for (let pass = 0; pass < PASSES; pass += 1) {
    for (let row = 0; row < height; row += 1) average(found, row * width, 1, width, radius);
    for (let column = 0; column < width; column += 1) average(found, column, width, height, radius);
  }
  return Uint8Array.from(found, (share) => Math.round(WHITE * share));
}

/** Replace a row or column by its running means; beyond its ends it goes on as there. */
function average(values: Float32Array, first: number, step: number, count: number, radius: number): void {
  const line = Float32Array.from({ length: count }, (_, index) => values[first + index * step]);
  const at = (index: number): number => line[Math.min(count - 1, Math.max(0, index))];
  let sum = 0;
  for (let index = -radius; index <= radius; index += 1) sum += at(index);
  for (let index = 0; index < count; index += 1) {
    values[first + index * step] = sum / (2 * radius + 1);
    sum += at(index + radius + 1) - at(index - radius);
  }
}
