// What is placed and painted on a photograph. Every change makes a new document, so that undo keeps the old ones.
import type { Brush } from "./photo-canvas";
import { bounded, type Corners, type Spot, surface, type Weights } from "./bezier";
import type { BrushRecipe, PatchRecipe, PhotoRecipe } from "./messages";

export interface PhotoDocument {
  readonly patches: PatchRecipe[];
  readonly areas: Record<string, BrushRecipe[]>;
}
/** A corner, a control point by row and column, or the whole patch. */
export type Handle = { kind: "corner"; at: number } | { kind: "control"; row: number; column: number } | { kind: "whole" };

export const EMPTY: PhotoDocument = { patches: [], areas: {} };
const CORNERS = [[0, 0], [0, 3], [3, 3], [3, 0]] as const;

/** What a recipe has of a photograph, as it is written here: without what is not given. */
export function documentOf(recipe: PhotoRecipe | null | undefined): PhotoDocument {
  const { patches = EMPTY.patches, areas = EMPTY.areas } = recipe ?? {};
  return JSON.parse(JSON.stringify({ patches, areas }, (_, value) => (value === null ? undefined : value)));
}

const kept = ([row, column]: Spot): Spot => [bounded(row), bounded(column)];
const minus = (one: Spot, other: Spot): Spot => [one[0] - other[0], one[1] - other[1]];

export function withPlane(document: PhotoDocument, corners: Corners): [PhotoDocument, string] {
  const taken = new Set(document.patches.map((patch) => patch.name));
  let count = 1;
  while (taken.has(`plane_${count}`)) count += 1;
  const name = `plane_${count}`;
  return [{ ...document, patches: [...document.patches, { name, corners }] }, name];
}

export function without(document: PhotoDocument, name: string): PhotoDocument {
  return { ...document, patches: document.patches.filter((patch) => patch.name !== name) };
}

export function changed(document: PhotoDocument, name: string, change: (patch: PatchRecipe) => PatchRecipe): PhotoDocument {
  return { ...document, patches: document.patches.map((patch) => (patch.name === name ? change(patch) : patch)) };
}

/** A plane as a curved patch. */
function curved(patch: PatchRecipe): PatchRecipe {
  if (!patch.corners) return patch;
  const { corners: _, ...others } = patch;
  return { ...others, ...surface(patch) };
}

/** A patch with one of its points, or all of them, elsewhere. */
export function moved(patch: PatchRecipe, handle: Handle, to: Spot): PatchRecipe {
  const [row, column] = minus(to, placeOf(patch, handle));
  const shifted = (point: Spot, share: number): Spot => kept([point[0] + share * row, point[1] + share * column]);
  if (handle.kind === "control") {
    const bent = curved(patch);
    const controls = bent.controls!.map((points, i) =>
      points.map((point, j) => (i === handle.row && j === handle.column ? kept(to) : point)),
    );
    return { ...bent, controls: controls as PatchRecipe["controls"] };
  }
  if (patch.corners) {
    const corners = patch.corners.map((point, number) =>
      shifted(point, handle.kind === "whole" || number === handle.at ? 1 : 0),
    );
    return { ...patch, corners: corners as Corners };
  }
  // The other points follow a corner by the plane's bilinear share.
  const share = (i: number, j: number): number => {
    if (handle.kind === "whole") return 1;
    const [down, across] = CORNERS[handle.at];
    return (Math.abs(i - (3 - down)) / 3) * (Math.abs(j - (3 - across)) / 3);
  };
  const controls = patch.controls!.map((points, i) => points.map((point, j) => shifted(point, share(i, j))));
  return { ...patch, controls: controls as PatchRecipe["controls"] };
}

export function placeOf(patch: PatchRecipe, handle: Handle): Spot {
  const controls = patch.controls ?? surface(patch).controls;
  if (handle.kind === "control") return controls[handle.row][handle.column];
  const corners = patch.corners ?? CORNERS.map(([row, column]) => controls[row][column]);
  if (handle.kind === "corner") return corners[handle.at];
  const middle = patch.corners ?? [controls[1][1], controls[1][2], controls[2][1], controls[2][2]];
  return [0, 1].map((axis) => middle.reduce((sum, point) => sum + point[axis] / 4, 0)) as Spot;
}

/** The points of a patch that can be dragged. */
export function handlesOf(isCurved: boolean): Handle[] {
  if (!isCurved) return [...CORNERS.map((_, at): Handle => ({ kind: "corner", at })), { kind: "whole" }];
  return [0, 1, 2, 3].flatMap((row) => [0, 1, 2, 3].map((column): Handle => ({ kind: "control", row, column })));
}

export function weighted(patch: PatchRecipe, row: number, column: number, weight: number): PatchRecipe {
  const bent = curved(patch);
  const weights = surface(bent).weights.map((values, i) =>
    values.map((value, j) => (i === row && j === column ? weight : value)),
  );
  return { ...bent, weights: weights as Weights };
}

export function painted(document: PhotoDocument, area: string, edit: BrushRecipe): PhotoDocument {
  return { ...document, areas: { ...document.areas, [area]: [...(document.areas[area] ?? []), edit] } };
}

export function cleared(document: PhotoDocument, area: string): PhotoDocument {
  const { [area]: _, ...areas } = document.areas;
  return { ...document, areas };
}

/** The points of a stroke, as near to each other as its radius needs; the last one of a fill. */
export function thinned(points: Spot[], { tool, radius }: Brush): Spot[] {
  if (tool === "fill") return [points.at(-1)!];
  const distance = tool === "stroke" ? Math.max(1, radius! / 6) : 1;
  const kept: Spot[] = [];
  for (const [row, column] of points) {
    const [above, before] = kept.at(-1) ?? [Infinity, Infinity];
    if (Math.hypot(row - above, column - before) >= distance) kept.push([Math.round(10 * row) / 10, Math.round(10 * column) / 10]);
  }
  return kept;
}
