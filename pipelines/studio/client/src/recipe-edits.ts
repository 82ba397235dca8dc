// How a recipe changes with its pictures and its method.
import type { Method, Picture, Recipe } from "./messages";
import { sides, sizeText } from "./sizes";

/** that a recipe has without one */
export const SEED = 7;

/** The exemplar, or the several pictures in their order. */
export const picturesOf = (recipe: Recipe | null | undefined): string[] => [Object.values(recipe?.sources ?? {})[0] ?? []].flat();

/** The mesh that its texture covers; empty: none. */
export const meshOf = ({ flow, sources }: Recipe): string => (flow === "on_mesh" ? String(sources.mesh) : "");

/** The sources with other pictures in place of the exemplar or of the several ones. */
export function withPictures(sources: Recipe["sources"], method: Method, pictures: string[]): Recipe["sources"] {
  const others = Object.entries(sources).filter(([name]) => method.others.some((one) => one.source === name));
  const [name, given] = method.several ? [method.several.source, pictures] : [method.exemplar, pictures[0]];
  return { ...(pictures.length ? { [name]: given } : {}), ...Object.fromEntries(others) };
}

/** Other pictures, or another order; each keeps its weight. */
export function reordered(recipe: Recipe, method: Method, pictures: string[]): Partial<Recipe> {
  const { [method.several!.weights]: weights, ...lists } = recipe.lists ?? {};
  const before = picturesOf(recipe);
  if (weights && pictures.length) lists[method.several!.weights] = pictures.map((id) => weights[before.indexOf(id)] ?? 1);
  return { sources: withPictures(recipe.sources, method, pictures), lists };
}

/** A picture more, or one less where it is among them. */
export function toggled(recipe: Recipe, method: Method, id: string): Partial<Recipe> {
  const pictures = picturesOf(recipe);
  return reordered(recipe, method, pictures.includes(id) ? pictures.filter((one) => one !== id) : [...pictures, id]);
}

/** Whether there are as many pictures as a method takes. */
export const isFull = (recipe: Recipe, method: Method): boolean => picturesOf(recipe).length >= method.several!.most;
export const tooMany = ({ name }: Picture, method: Method): string =>
  `${name}: there are ${method.several!.most} pictures already, the most that this takes; remove one first`;

/** The recipe with what another method takes of it. */
export function withMethod(recipe: Recipe, method: Method): Recipe {
  const pictures = picturesOf(recipe).slice(0, method.several?.most ?? 1);
  const uniformity = method.uniformity && recipe.params?.[method.uniformity];
  return {
    ...recipe,
    flow: method.flow,
    sources: withPictures(recipe.sources, method, pictures),
    size: method.size && (recipe.size ?? method.size),
    tileable: method.can_tile ? (recipe.tileable ?? (method.tiles ? "both" : null)) : null,
    preset: method.presets.includes(recipe.preset ?? "") ? recipe.preset : null,
    params: uniformity ? { [method.uniformity]: uniformity } : {},
    lists: {},
    files: {},
    udim: null,
  };
}

/** What a picture is, as far as its file tells. */
export const beginsWith = (picture: Picture): Method["begins"] =>
  picture.is_material ? "maps" : picture.is_photograph ? "photograph" : "picture";

/** A recipe that begins with a picture, or goes on with it. */
export function withExemplar(recipe: Recipe | null, picture: Picture, methods: Method[]): Recipe {
  const begins = beginsWith(picture);
  const before = methods.find((one) => one.flow === recipe?.flow && !one.layer);
  const method = before?.begins === begins ? before : methods.find((one) => one.begins === begins && !one.layer)!;
  const { flow } = method;
  const begun = recipe ?? { flow, sources: {}, seed: SEED, size: doubled(picture, method) };
  const changed = begun.flow === flow ? begun : withMethod(begun, method);
  const tileable = changed.tileable ?? (method.tiles ? "both" : null);
  const isSame = picturesOf(recipe)[0] === picture.id; // else what was drawn is of another picture
  return { ...changed, tileable, sources: withPictures(changed.sources, method, [picture.id]), ...(isSame ? {} : { mask: null, files: {} }) };
}

/** What has still to be chosen before anything can be made; empty: nothing. */
export function lacking(recipe: Recipe | null, method: Method): string {
  const { several } = method;
  if (recipe && several && picturesOf(recipe).length < several.least) return `${COUNTS[several.least]} pictures or more`;
  return method.others.find((one) => one.is_required && !recipe?.sources[one.source])?.about ?? "";
}
const COUNTS: Record<number, string> = { 2: "two" };

/** Twice the exemplar in round numbers, but no more than the method's own size. */
function doubled(picture: Picture, method: Method): string {
  const side = 2 ** Math.round(Math.log2(2 * Math.max(picture.height, picture.width)));
  const size = Math.min(Math.max(...sides(method.size!)), Math.max(256, side));
  return sizeText([size, size]);
}
