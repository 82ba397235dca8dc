// What methods are called; their flows keep their names in files and on the command line.
const NAMES: Record<string, string> = {
  self_tuning: "All-round", near_regular: "Tiles and weaves", quilting: "Large pieces", graph_cut: "Large pieces by the best seams",
  patch_based: "Grain", per_pixel: "Grain pixel by pixel", remix: "One of several", mix: "From one to the next",
  grow: "Ageing and trends", restyle: "Another picture restyled", vary: "Tiles of versions", transition_tiles: "Terrain tiles",
  endless: "Endless plane", materials: "Maps", material_synthesis: "All maps", photo_material: "All maps of a photograph",
  rectify_pieces: "Collage", per_pixel_control: "Painted", on_mesh: "On a mesh", photo_flattening: "Flattened", photo_to_texture: "From a photograph",
  photo_completion: "Filled", photo_to_photo: "Placed", revise: "Correction",
};

/** The words of a flow of which there is no name here. */
export const words = (flow: string): string => {
  const text = flow.replaceAll("_", " ");
  return text[0].toUpperCase() + text.slice(1);
};
export const methodName = (flow: string): string => NAMES[flow] ?? words(flow);
