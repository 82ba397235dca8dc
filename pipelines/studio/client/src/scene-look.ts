// How a lit material is looked at.
export type Shape = "plane" | "sphere" | "cube" | "cloth";

/** How a material is looked at. */
export interface SceneLook {
  shape: Shape;
  /** tiles along a side */
  repeat: number;
  /** direction of the light: around the view's axis, and above its plane, degrees */
  around: number;
  above: number;
  /** stops */
  exposure: number;
  /** how far heights stand out, percent of a side */
  relief: number;
}
export const FIRST_LOOK: SceneLook = { shape: "plane", repeat: 1, around: 45, above: 50, exposure: 0, relief: 0 };
