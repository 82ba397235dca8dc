// Meshes as the server sends them.

/** 8 values of each corner: position, normal, texture coordinates; three corners a face. */
export type Corners = Float32Array;
export const VALUES = 8; // of a corner
