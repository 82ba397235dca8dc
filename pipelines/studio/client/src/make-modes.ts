// The ways to look at what is made.
import type { Method } from "./messages";
import type { Mode } from "./picture-view";

export type Shown = Mode | "variants";
export const MODES: Record<Shown, string> = { single: "Single", repeat: "Repeat", compare: "Compare", variants: "Variants" };

/** Those of a method; tiles are no texture beside its exemplar, and a photograph shows it otherwise. */
export function modesOf(method: Method): Partial<Record<Shown, string>> {
  const { single, repeat, variants } = MODES;
  if (!method.is_texture) return { single, variants };
  return method.begins === "photograph" ? { single, repeat, variants } : MODES;
}

/** Beside each other, or one of them. */
export type Space = "flat" | "both" | "lit";
export const SPACES: Record<Space, string> = { flat: "2D", both: "2D and 3D", lit: "3D" };
const KEY = "texloom space";

/** What this person has chosen last; nothing where none was. */
export const chosenSpace = (): Space | null => {
  const kept = localStorage.getItem(KEY);
  return kept !== null && kept in SPACES ? (kept as Space) : null;
};
export const keepSpace = (space: Space): void => localStorage.setItem(KEY, space);
