// Recipes as keys: equal where they make the same result.
import type { Recipe } from "./messages";
import { SEED } from "./recipe-edits";

/** A text that is equal for equal recipes, whichever of their fields are left out or have their defaults. */
export function recipeKey(recipe: Recipe | null): string {
  if (!recipe) return "";
  const given = { ...recipe, seed: recipe.seed ?? SEED, tileable: recipe.tileable === "off" ? null : recipe.tileable };
  return JSON.stringify(plain(given));
}

function plain(value: unknown): unknown {
  if (Array.isArray(value)) return value.map(plain);
  if (typeof value !== "object" || value === null) return value;
  const entries = Object.entries(value).map(([name, one]) => [name, plain(one)] as const);
  const kept = entries.filter(([, one]) => one !== null && one !== undefined && !isEmpty(one));
  return Object.fromEntries(kept.sort(([one], [other]) => (one < other ? -1 : 1)));
}

const isEmpty = (value: unknown): boolean => typeof value === "object" && value !== null && Object.keys(value).length === 0;
