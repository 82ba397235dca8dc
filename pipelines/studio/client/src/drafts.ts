// Recipes whose layers and documents are still in the page.
import type { Recipe } from "./messages";
import { keepDocument, PAINTED, upload } from "./server";

/** Ids `attached:NAME` of the recipe stand for what is attached: NAME.png is a picture, NAME.json a document. */
export interface Draft {
  recipe: Recipe;
  attached: Record<string, Blob>;
}

/** The recipe, when the server has kept all that is attached. */
export async function kept({ recipe, attached }: Draft): Promise<Recipe> {
  const ids: Record<string, string> = {};
  for (const [name, blob] of Object.entries(attached)) {
    ids[`attached:${name}`] = name.endsWith(".png")
      ? (await upload([new File([blob], `${PAINTED}${name}`)], "")).id
      : await keepDocument(name.replace(".json", ""), JSON.parse(await blob.text()));
  }
  const known = (id: string): string => ids[id] ?? id;
  const sources = mapped(recipe.sources, (given) => (typeof given === "string" ? known(given) : given.map(known)));
  return { ...recipe, sources, mask: recipe.mask && known(recipe.mask), files: mapped(recipe.files ?? {}, known) };
}

const mapped = <Value>(values: Record<string, Value>, change: (value: Value) => Value): Record<string, Value> =>
  Object.fromEntries(Object.entries(values).map(([name, value]) => [name, change(value)]));

/** A document to attach. */
export const document = (content: object): Blob => new Blob([JSON.stringify(content)]);

/** A canvas as a picture to attach. */
export const picture = (canvas: HTMLCanvasElement): Promise<Blob> =>
  new Promise((done) => canvas.toBlob((blob) => done(blob!), "image/png"));
