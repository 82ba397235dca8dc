// A mesh in three dimensions with its texture, on which directions and values are painted.
import {
  CanvasTexture, CatmullRomCurve3, Mesh, MeshBasicMaterial, MeshStandardMaterial, Raycaster, SRGBColorSpace, TubeGeometry, Vector2,
  Vector3,
} from "three";
import type { Corners } from "./corners";
import { type Hit, rounded } from "./mesh-strokes";
import { type Maps, MaterialScene } from "./scene";
import type { TexelMap } from "./texel-map";

const ABOVE = 0.004; // how far lines are above the surface, of its radius
const THICKNESS = 0.008; // of lines, likewise

export class MeshScene extends MaterialScene {
  private readonly lines: Mesh[] = [];
  private readonly ink = new MeshBasicMaterial({ color: 0xffd166 });
  private shown: CanvasTexture | null = null;
  /** what is shown where no values are */
  private under = new MeshStandardMaterial({ color: 0x9aa1a9, roughness: 0.8 });
  private readonly values = new MeshStandardMaterial({ roughness: 0.9 });

  override setMesh(corners: Corners, isCharted = true): void {
    super.setMesh(corners, isCharted);
    this.under = new MeshStandardMaterial({ color: 0x9aa1a9, roughness: 0.8 });
    this.mesh.material = this.under;
    this.draw();
  }

  override async setMaps(maps: Maps): Promise<boolean> {
    const { under } = this;
    const isShown = await super.setMaps(maps);
    if (!isShown) return false;
    under.dispose();
    this.under = this.mesh.material;
    if (this.shown) this.mesh.material = this.values;
    this.draw();
    return true;
  }

  /** Whether dragging turns the mesh, or paints. */
  setTurning(is: boolean): void {
    this.controls.enableRotate = this.controls.enablePan = is;
  }

  /** The size of the mesh: radius of the sphere around it. */
  get radius(): number {
    return this.mesh.geometry.boundingSphere?.radius ?? 1;
  }

  /** What is on the surface under a place of the canvas, in shares of it. */
  pick(x: number, y: number): Hit | null {
    const caster = new Raycaster();
    this.camera.updateMatrixWorld(); // as the next frame will show it, also before the first one
    this.mesh.updateWorldMatrix(true, false);
    caster.setFromCamera(new Vector2(2 * x - 1, 1 - 2 * y), this.camera);
    const hit = caster.intersectObject(this.mesh, false)[0];
    if (!hit?.uv || !hit.face) return null;
    return rounded([...this.mesh.worldToLocal(hit.point.clone()), ...hit.face.normal, 1 - hit.uv.y, hit.uv.x]);
  }

  /** Show lines on the surface. */
  setStrokes(strokes: readonly (readonly Hit[])[]): void {
    for (const line of this.lines.splice(0)) {
      line.geometry.dispose();
      this.mesh.remove(line);
    }
    strokes.forEach((hits) => this.addLine(hits));
    this.draw();
  }

  private addLine(hits: readonly Hit[]): void {
    const places = hits.map((hit) => new Vector3().fromArray(hit).addScaledVector(new Vector3().fromArray(hit, 3), ABOVE * this.radius));
    if (places.length < 2) return;
    const tube = new TubeGeometry(new CatmullRomCurve3(places), 2 * places.length, THICKNESS * this.radius, 6);
    const line = new Mesh(tube, this.ink);
    this.lines.push(line);
    this.mesh.add(line);
  }

  /** Show painted values in place of the texture; null shows the texture again. */
  showValues(map: TexelMap | null): void {
    this.shown?.dispose();
    this.shown = null;
    if (map) {
      this.shown = new CanvasTexture(map.canvas);
      this.shown.colorSpace = SRGBColorSpace;
      this.values.map = this.shown;
      this.values.needsUpdate = true;
    }
    this.mesh.material = map ? this.values : this.under;
    this.draw();
  }

  updateValues(): void {
    if (this.shown) this.shown.needsUpdate = true;
    this.draw();
  }
}
