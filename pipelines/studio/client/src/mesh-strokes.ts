// Strokes on a mesh.
import type { DrawnMesh } from "./messages";

/** A place of the surface: position, normal, and row and column in its texture, as shares from the upper left corner. */
export type Hit = DrawnMesh["strokes"][number][number];

/** What is painted: lines, and amounts at the pixels of a `TexelMap`. */
export interface Painted {
  strokes: readonly Hit[][];
  codes: Uint8Array | null;
}
export const NOTHING: Painted = { strokes: [], codes: null };

const BROKEN = 0.1; // of the texture: points of a stroke that are farther apart are on other charts
const DIGITS = 1e6; // to the hundredth of a pixel of a texture of 8192 px

/** In as many digits as are kept, so that what comes back is the same. */
export const rounded = (hit: number[]): Hit => hit.map((one) => Math.round(one * DIGITS) / DIGITS) as Hit;

/** A stroke as lines of the texture, px, cut where it goes on in another chart. */
export function linesOf(stroke: readonly Hit[], side: number): [number, number][][] {
  const lines: [number, number][][] = [];
  let before: [number, number] | null = null;
  for (const [, , , , , , row, column] of stroke) {
    if (!before || Math.hypot(row - before[0], column - before[1]) > BROKEN) lines.push([]);
    lines.at(-1)!.push([row * side - 0.5, column * side - 0.5]);
    before = [row, column];
  }
  return lines.filter((line) => line.length > 1);
}
