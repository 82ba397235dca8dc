// A lit material in three dimensions. Loaded when it is first looked at.
import {
  Color, DirectionalLight, DoubleSide, Mesh, MeshPhysicalMaterial, MeshStandardMaterial, PerspectiveCamera, PlaneGeometry, PMREMGenerator,
  RepeatWrapping, Scene, SphereGeometry, SRGBColorSpace, type Texture, TextureLoader, Vector2, WebGLRenderer,
  type BufferGeometry,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";

import type { Corners } from "./corners";
import { geometryOf } from "./mesh-geometry";

export const SHAPES = { plane: "Plane", sphere: "Sphere", cloth: "Cloth" } as const;
export type Shape = keyof typeof SHAPES;
/** role of a map to its address */
export type Maps = Record<string, string>;

const SEGMENTS = 192;
const FOLDS = 0.12; // height of a fold of the cloth, of its side
const DISTANCE = 3;

export class MaterialScene {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  protected readonly camera = new PerspectiveCamera(36, 1, 0.1, 50);
  protected readonly controls: OrbitControls;
  private readonly light = new DirectionalLight(0xffffff, 2.6);
  protected readonly mesh = new Mesh<BufferGeometry, MeshStandardMaterial>();
  private textures: Texture[] = [];
  hasMesh = false;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    const generator = new PMREMGenerator(this.renderer);
    this.scene.environment = generator.fromScene(new RoomEnvironment(), 0.04).texture;
    this.scene.environmentIntensity = 0.35;
    this.scene.add(this.light, this.mesh);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.setShape("plane");
    this.setLight(45, 50);
  }

  /** Show a mesh, whose middle is turned about. */
  setMesh(corners: Corners): void {
    this.hasMesh = true;
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometryOf(corners);
    this.mesh.geometry.computeBoundingSphere();
    const { center, radius } = this.mesh.geometry.boundingSphere!;
    this.mesh.scale.setScalar(1 / radius);
    this.mesh.position.copy(center).multiplyScalar(-1 / radius);
    this.camera.position.set(1.4, 1.1, 2.9);
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.draw();
  }

  setShape(shape: Shape): void {
    this.hasMesh = false;
    this.mesh.scale.setScalar(1);
    this.mesh.position.set(0, 0, 0);
    this.mesh.geometry.dispose();
    this.mesh.geometry = shapeOf(shape);
    const [x, y, z] = shape === "sphere" ? [0, 0, DISTANCE] : [0, -1.1, DISTANCE];
    this.camera.position.set(x, y, z);
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.draw();
  }

  /** Direction of the light: around the view's axis, and above its plane, degrees. */
  setLight(around: number, above: number): void {
    const [a, b] = [(around * Math.PI) / 180, (above * Math.PI) / 180];
    this.light.position.set(Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.sin(b)).multiplyScalar(5);
    this.draw();
  }

  setRepeat(count: number): void {
    this.textures.forEach((texture) => texture.repeat.set(count, count));
    this.draw();
  }

  async setMaps(maps: Maps, repeat: number): Promise<void> {
    this.textures.forEach((texture) => texture.dispose());
    const loader = new TextureLoader();
    const entries = await Promise.all(
      Object.entries(maps).map(async ([role, address]) => [role, await loader.loadAsync(address)] as const),
    );
    this.textures = entries.map(([, texture]) => texture);
    const of = (role: string) => entries.find(([name]) => name === role)?.[1] ?? null;
    for (const [role, texture] of entries) {
      texture.wrapS = texture.wrapT = RepeatWrapping;
      texture.anisotropy = 8;
      if (role === "albedo" || role === "emissive") texture.colorSpace = SRGBColorSpace;
    }
    const material = new MeshPhysicalMaterial({
      side: DoubleSide, color: new Color(0xffffff), map: of("albedo"), normalMap: of("normal") ?? of("normal_dx"),
      roughnessMap: of("roughness"), roughness: of("roughness") ? 1 : 0.75, metalnessMap: of("metallic"),
      metalness: of("metallic") ? 1 : 0, aoMap: of("ao"),
    });
    if (of("normal_dx")) material.normalScale = new Vector2(1, -1);
    else if (!of("normal") && of("height")) {
      material.bumpMap = of("height");
      material.bumpScale = 2;
    }
    this.mesh.material.dispose();
    this.mesh.material = material;
    this.setRepeat(repeat);
  }

  draw(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }

  dispose(): void {
    this.textures.forEach((texture) => texture.dispose());
    this.mesh.geometry.dispose();
    this.controls.dispose();
    this.renderer.dispose();
  }
}

function shapeOf(shape: Shape): BufferGeometry {
  if (shape === "sphere") return new SphereGeometry(0.8, SEGMENTS, SEGMENTS / 2);
  const geometry = new PlaneGeometry(1.7, 1.7, SEGMENTS, SEGMENTS);
  if (shape === "cloth") {
    const places = geometry.attributes.position;
    for (let index = 0; index < places.count; index += 1) {
      const [x, y] = [places.getX(index), places.getY(index)];
      places.setZ(index, FOLDS * (Math.sin(4.2 * x + 1.3 * Math.sin(2.1 * y)) + 0.5 * Math.sin(5.1 * y + 2.2 * x)));
    }
    geometry.computeVertexNormals();
  }
  return geometry;
}
