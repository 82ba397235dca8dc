// The ways to look at what is made.
import { hasPreview, type LayerName } from "./layers";
import type { Method } from "./messages";
import type { Mode, Patch, Point } from "./picture-view";
import type { Kind } from "./variants";

export type Shown = Mode | "variants";
export const MODES: Record<Shown, string> = { single: "Single", repeat: "Repeat", compare: "Compare", variants: "Variants" };

/** Those of a method; tiles are no texture beside its exemplar, and a photograph shows it otherwise. */
export function modesOf(method: Method): Partial<Record<Shown, string>> {
  const { single, repeat, variants } = MODES;
  if (!hasPreview(method)) return { single };
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

/** How a material is looked at. */
export interface MakeState {
  mode: Shown;
  /** of variants */
  kind: Kind;
  /** the export that is shown of a result; empty: the first one */
  file: string;
  layer: LayerName;
  isCorrecting: boolean;
  outline: Point[];
  patch: Patch | null;
}
export const UNCORRECTED = { isCorrecting: false, outline: [], patch: null };
export const FIRST_STATE: MakeState = { mode: "single", kind: "seeds", file: "", layer: "result", ...UNCORRECTED };
