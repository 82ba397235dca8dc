// What the files of a result are for.

/** In the order in which files are listed. */
const FILES: Record<string, string> = {
  "texture.png": "for display", "maps/": "all maps", "texture.exr": "linear light", "report.html": "measures and pictures",
  "detail.png": "around the spot", "preview.png": "laid out", "origin.png": "which picture", "scores.json": "measures",
  "corners.png": "tiles by their corners", "blob.png": "tiles by what is around", "edges.png": "tiles of paths",
  "edges_preview.png": "paths, laid out", "hex.png": "hexagons, laid out", "cells_preview.png": "cells, laid out", "tiles.json": "which tile is which", "progression.png": "trend found",
  "target.png": "trend laid over", "inverse.data.png": "tables of the shader; not colour", "suitability.json": "whether it suits", "exemplars.json": "shares",
};
/** By how their names end; the longest first. */
const ENDS: Record<string, string> = {
  ".png.meta": "Unity, sprites", ".data.png": "for the shader; not colour", ".asset": "Unity, rule tile", ".tres": "Godot 4, tile set",
  ".tsx": "Tiled, tile set", ".gdshader": "Godot 4, shader", ".glsl": "GLSL, OpenGL and WebGL", ".hlsl": "Unity and Unreal", ".osl": "Blender and others",
  ".mtlx": "MaterialX",
};
const ORDER = Object.keys(FILES);
const rank = (file: string): number => (ORDER.includes(file) ? ORDER.indexOf(file) : ORDER.length);

export const inOrder = (files: readonly string[]): string[] => [...files].sort((one, other) => rank(one) - rank(other));

export const aboutFile = (file: string): string => FILES[file] ?? Object.entries(ENDS).find(([end]) => file.endsWith(end))?.[1] ?? "";
