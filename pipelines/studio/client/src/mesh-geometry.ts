// Meshes of the server as three has them.
import { BufferAttribute, BufferGeometry } from "three";
import { type Corners, VALUES } from "./corners";

export function geometryOf(corners: Corners): BufferGeometry {
  const geometry = new BufferGeometry();
  const part = (from: number, size: number): BufferAttribute => {
    const values = new Float32Array((corners.length / VALUES) * size);
    for (let corner = 0; corner * VALUES < corners.length; corner += 1) {
      for (let at = 0; at < size; at += 1) values[corner * size + at] = corners[corner * VALUES + from + at];
    }
    return new BufferAttribute(values, size);
  };
  geometry.setAttribute("position", part(0, 3));
  geometry.setAttribute("normal", part(3, 3));
  geometry.setAttribute("uv", part(6, 2));
  return geometry;
}
