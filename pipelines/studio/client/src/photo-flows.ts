// What can be made from a photograph's surfaces, as recipes of flows.
import type { Tiling } from "./fields";
import type { PhotoRecipe, Recipe } from "./messages";
import { keepPhoto } from "./server";
import { sizeText } from "./sizes";

export const PURPOSES = {
  flatten: {
    flow: "photo_flattening", short: "Flatten", label: "Flatten", hasSize: true,
    about: "A flat texture by the better of two methods; where structure matters, as in walls, rows stay straight.",
  },
  texture: {
    flow: "photo_to_texture", short: "Texture", label: "Make a texture", hasSize: true,
    about: "A flat texture synthesised in the photograph itself; also of strongly curved or foreshortened surfaces.",
  },
  fill: {
    flow: "photo_completion", short: "Fill", label: "Fill the hole", hasSize: false,
    about: "The painted hole is filled with the texture around it, as it lies there.",
  },
  place: {
    flow: "photo_to_photo", short: "Place", label: "Place it", hasSize: false,
    about: "The hole of another photograph is covered with this texture, at its real size.",
  },
} as const;
export type Purpose = keyof typeof PURPOSES;

export interface Settings {
  purpose: Purpose;
  side: number;
  tileable: Tiling;
  seed: number;
  /** id of the other photograph */
  scene: string;
}

/** The recipe, whose geometry files are written now. */
export async function photoFlow(photo: PhotoRecipe, scene: PhotoRecipe | null, settings: Settings): Promise<Recipe> {
  const { flow, hasSize } = PURPOSES[settings.purpose];
  const files = { "surface.geometry": (await keepPhoto(photo)).geometry };
  const recipe: Recipe = { flow, sources: { photo: photo.photo }, files, seed: settings.seed };
  if (hasSize) Object.assign(recipe, { size: sizeText([settings.side, settings.side]), tileable: settings.tileable });
  if (settings.purpose !== "place" || !scene) return recipe;
  return {
    ...recipe,
    sources: { ...recipe.sources, scene: scene.photo },
    files: { ...files, "place.geometry": (await keepPhoto(scene)).geometry },
  };
}
