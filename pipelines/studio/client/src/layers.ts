// The layers of a material: what is drawn on its picture and its result says what is to lie where.
import type { Method, Recipe } from "./messages";
import { withMethod, withPictures, picturesOf } from "./recipe-edits";

export const LAYERS = { result: "Result", guides: "Guides", collage: "Collage", lattice: "Lattice", paint: "Paint", mesh: "Mesh" } as const;
/** `result`: nothing is drawn; `surfaces`: on a photograph */
export type LayerName = keyof typeof LAYERS | "surfaces";

/** the source of a recipe to what it tells */
const DRAWN: Record<string, string> = { exemplar_structure: "structure", target_guide: "areas", strokes: "direction" };
/** the param of what guides are */
export const KIND = "guide.kind";

/** The layers on which previews of their own begin with the first stroke; on others the material's would go on behind them. */
const BEGINNING: readonly LayerName[] = ["result", "guides", "collage", "lattice"];
export const isHeld = (layer: LayerName): boolean => !BEGINNING.includes(layer);

/** Whether small versions of a method's pictures show what it will make. */
export const hasPreview = ({ layer }: Method): boolean => layer === "" || layer === "collage";

/** What is drawn of a recipe, in words; empty: nothing. */
export function drawnOn(recipe: Recipe, { layer }: Method): string {
  if (layer) return { collage: "a collage", paint: "a painted map", mesh: "a mesh", surfaces: "surfaces of a photograph" }[layer];
  const guides = Object.keys(DRAWN).filter((one) => one in recipe.sources).map((one) => DRAWN[one]);
  return [recipe.mask ? "parts left out" : "", ...guides, ...Object.keys(recipe.files ?? {}).map(() => "a lattice")].filter(Boolean).join(", ");
}

/** The recipe without what is drawn. */
export function undrawn(recipe: Recipe, method: Method, methods: Method[]): Recipe {
  const plain = methods.find(({ begins, layer }) => begins === method.begins && !layer)!;
  if (method.layer) return withMethod(recipe, plain);
  const { [KIND]: _, ...params } = recipe.params ?? {};
  return { ...recipe, sources: withPictures(recipe.sources, method, picturesOf(recipe)), mask: null, files: {}, params };
}
