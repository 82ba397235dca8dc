// Planes in perspective and rational bicubic Bézier patches, as geometry files have them. Points are [row, column].
import type { PatchRecipe } from "./messages";

export type Spot = [number, number];
export type Controls = NonNullable<PatchRecipe["controls"]>;
export type Weights = NonNullable<PatchRecipe["weights"]>;
export type Corners = NonNullable<PatchRecipe["corners"]>;

const AT = [0, 1, 2, 3] as const;
const POINTS = 32; // pieces of a line
const FARTHEST = 1e5; // px; what is farther is refused

export const bounded = (value: number): number => Math.min(FARTHEST, Math.max(-FARTHEST, value));

/** Control points and weights of the plane through four corners, clockwise from the texture's origin. */
export function controlsOf(corners: Corners): { controls: Controls; weights: Weights } {
  const [p0, p1, p2, p3] = corners;
  const minus = (one: Spot, other: Spot): Spot => [one[0] - other[0], one[1] - other[1]];
  const cross = (one: Spot, other: Spot): number => one[0] * other[1] - one[1] * other[0];
  const [first, second] = [minus(p1, p2), minus(p3, p2)];
  const sum: Spot = [p0[0] - p1[0] + p2[0] - p3[0], p0[1] - p1[1] + p2[1] - p3[1]];
  const area = cross(first, second) || 1e-9;
  const [g, h] = [cross(sum, second) / area, cross(first, sum) / area];
  const weight = (down: number, across: number) => bounded(g * across + h * down + 1 || 1e-9);
  const at = (down: number, across: number): Spot => {
    const of = (axis: 0 | 1) =>
      ((p1[axis] * (1 + g) - p0[axis]) * across + (p3[axis] * (1 + h) - p0[axis]) * down + p0[axis]) / weight(down, across);
    return [bounded(of(0)), bounded(of(1))];
  };
  return {
    controls: AT.map((i) => AT.map((j) => at(i / 3, j / 3))) as Controls,
    weights: AT.map((i) => AT.map((j) => weight(i / 3, j / 3))) as Weights,
  };
}

/** A patch's control points and weights, also of a plane. */
export function surface(patch: PatchRecipe): { controls: Controls; weights: Weights } {
  if (patch.corners) return controlsOf(patch.corners);
  const controls = patch.controls!;
  const corners: Corners = [controls[0][0], controls[0][3], controls[3][3], controls[3][0]];
  return { controls, weights: patch.weights ?? controlsOf(corners).weights };
}

const bernstein = (t: number): number[] => [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t ** 3];

export function pointAt({ controls, weights }: { controls: Controls; weights: Weights }, u: number, v: number): Spot {
  const [rows, columns] = [bernstein(u), bernstein(v)];
  let [row, column, total] = [0, 0, 0];
  for (const i of AT) {
    for (const j of AT) {
      const share = rows[i] * columns[j] * weights[i][j];
      row += share * controls[i][j][0];
      column += share * controls[i][j][1];
      total += share;
    }
  }
  return [row / total, column / total];
}

/** Points of the line at one parameter: down the patch at `v`, or across it at `u`. */
export function lineOf(patch: ReturnType<typeof surface>, at: number, isDown: boolean): Spot[] {
  return Array.from({ length: POINTS + 1 }, (_, step) =>
    isDown ? pointAt(patch, step / POINTS, at) : pointAt(patch, at, step / POINTS),
  );
}

/** The patch's border, clockwise. */
export function border(patch: ReturnType<typeof surface>): Spot[] {
  const [top, right, bottom, left] = [lineOf(patch, 0, false), lineOf(patch, 1, true), lineOf(patch, 1, false), lineOf(patch, 0, true)];
  return [...top, ...right, ...bottom.reverse(), ...left.reverse()];
}
