// What a texture might be instead: other seeds, methods and settings, and the results that there are.
import type { Method, Picture, Recipe, Variant } from "./messages";
import { presetName } from "./fields";
import { methodName } from "./method-names";
import type { Drawable } from "./picture-view";
import { picturesOf, SEED, withMethod } from "./recipe-edits";
import { sides } from "./sizes";

export type Kind = "seeds" | "methods" | "settings" | "results";
export const KINDS: Record<Kind, string> = { seeds: "Seeds", methods: "Methods", settings: "Settings", results: "Results" };
const SEEDS = 9; // in a sheet
const UNIFORMITIES = [0, 3, 10, 30, 100];
const MOST_RESULTS = 9; // the newest

export interface Cell {
  label: string;
  recipe: Recipe;
  /** of the material, where it is made already */
  result: Variant | null;
  picture: Drawable | null;
  problem: string;
}

/** The cells of a sheet, made one after the other. */
export interface Sheet {
  kind: Kind;
  cells: Cell[];
  /** the one that is being made */
  waiting: number;
}

const cell = (label: string, recipe: Recipe, result: Variant | null = null): Cell => ({ label, recipe, result, picture: null, problem: "" });

/** The cells of a kind, without their pictures. */
export function newSheet(kind: Kind, recipe: Recipe, methods: Method[], results: readonly Variant[]): Sheet {
  const cells = { seeds: seedsOf, methods: methodsOf, settings: settingsOf, results: () => resultsOf(results) }[kind](recipe, methods);
  return { kind, cells, waiting: 0 };
}

/** The sheet with a change of the cell that is being made; if nothing follows for it, the next one is. */
export function withCell({ kind, cells, waiting }: Sheet, change: Partial<Cell>, isFinal: boolean): Sheet {
  const changed = cells.map((one, index) => (index === waiting ? { ...one, ...change } : one));
  return { kind, cells: changed, waiting: waiting + (isFinal ? 1 : 0) };
}

function seedsOf(recipe: Recipe): Cell[] {
  const first = recipe.seed ?? SEED;
  return Array.from({ length: SEEDS }, (_, index) => cell(`Seed ${first + index}`, { ...recipe, seed: first + index }));
}

function methodsOf(recipe: Recipe, methods: Method[]): Cell[] {
  const { begins } = methods.find(({ flow }) => flow === recipe.flow)!;
  const fitting = methods.filter((one) => !one.layer && !one.has_maps && one.is_texture && !one.several && one.others.every((other) => !other.is_required));
  const isOne = begins !== "photograph" && picturesOf(recipe).length === 1;
  const others = isOne ? fitting.filter(({ flow }) => flow !== recipe.flow) : [];
  return [recipe, ...others.map((one) => withMethod(recipe, one))].map((one) => cell(methodName(one.flow), one));
}

function settingsOf(recipe: Recipe, methods: Method[]): Cell[] {
  const { presets, uniformity, default_uniformity } = methods.find(({ flow }) => flow === recipe.flow)!;
  const uniform = uniformity ? Number(recipe.params?.[uniformity] ?? default_uniformity) : 0;
  return [
    cell("As it is", recipe),
    ...presets.filter((one) => one !== (recipe.preset ?? "default")).map((preset) => cell(`Preset ${presetName(preset)}`, { ...recipe, preset })),
    ...(uniformity ? UNIFORMITIES : []).filter((one) => one !== uniform)
      .map((one) => cell(`Uniformity ${one}`, { ...recipe, params: { ...recipe.params, [uniformity]: one } })),
  ];
}

function resultsOf(results: readonly Variant[]): Cell[] {
  const done = results.filter(({ job }) => job.state === "done" && job.texture).reverse();
  return done.slice(0, MOST_RESULTS).map((one) => cell(named(one), one.job.recipe, one));
}

/** The recipe of a texture that leads from one result to another. */
export const blendOf = (results: readonly Variant[]): Recipe =>
  ({ flow: "mix", sources: { exemplars: results.map(({ job }) => job.texture) }, seed: SEED, size: results[0].job.recipe.size });

/** A result as a picture to start from. */
export function pictureOf(result: Variant, method: Method): Picture {
  const { recipe, texture, maps } = result.job;
  const [height, width] = sides(recipe.size ?? method.size ?? "1");
  return { id: texture, name: named(result), height, width, is_material: Object.keys(maps).length > 0, is_photograph: false };
}

/** How far a sheet is. */
export const progressOf = ({ cells, waiting }: Sheet): string => (waiting < cells.length ? `Making ${waiting + 1} of ${cells.length} …` : "");

/** What a result is called beside others. */
export const named = ({ job: { recipe }, parent }: Variant): string =>
  `Seed ${recipe.seed ?? SEED}, ${parent ? "correction" : methodName(recipe.flow).toLowerCase()}`;
