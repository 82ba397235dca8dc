// How a lit material is looked at.
export const SHAPES = { plane: "Plane", sphere: "Sphere", cube: "Cube", cloth: "Cloth", mesh: "Mesh" } as const;
export type Shape = keyof typeof SHAPES;
export const SURROUNDINGS = { studio: "a studio", sky: "a clear sky", overcast: "an overcast sky", evening: "an evening sky" } as const;
export type Surroundings = keyof typeof SURROUNDINGS;

/** How a material is looked at. */
export interface SceneLook {
  shape: Shape;
  /** id of the mesh, of that shape; empty: the first one */
  mesh: string;
  surroundings: Surroundings;
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
export const FIRST_LOOK: SceneLook = {
  shape: "plane", mesh: "", surroundings: "studio", repeat: 1, around: 45, above: 50, exposure: 0, relief: 0,
};
