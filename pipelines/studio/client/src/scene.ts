// A lit material in three dimensions. Loaded when it is first looked at.
import {
  BoxGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide, Mesh, MeshPhysicalMaterial, MeshStandardMaterial, PerspectiveCamera, PlaneGeometry, PMREMGenerator,
  RepeatWrapping, Scene, SphereGeometry, SRGBColorSpace, type Texture, TextureLoader, Vector2, WebGLRenderer, type WebGLRenderTarget,
  type BufferGeometry,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

import type { Corners } from "./corners";
import { geometryOf } from "./mesh-geometry";
import { FIRST_LOOK, type SceneLook, type Shape } from "./scene-look";
import { surroundings } from "./surroundings";

/** role of a map to its address, or to the picture itself */
export type Maps = Record<string, string | ImageBitmap | HTMLCanvasElement>;
const SEGMENTS = 256;
const FIELD = 36; // degrees of the view's shorter side
const LIGHT = 2.6;
const AROUND_LIGHT = 0.35;
const SIDE = 1.7; // of the plane
const FOLDS = 0.12; // height of a fold of the cloth, of its side
const DISTANCE = 3;

export class MaterialScene {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  protected readonly camera = new PerspectiveCamera(FIELD, 1, 0.1, 50);
  protected readonly controls: OrbitControls;
  private readonly light = new DirectionalLight(0xffffff, LIGHT);
  protected readonly mesh = new Mesh<BufferGeometry, MeshStandardMaterial>();
  private textures: Texture[] = [];
  private look = FIRST_LOOK;
  private surrounded = "";
  private around: WebGLRenderTarget | null = null;
  private wanted: Maps | null = null;
  hasMesh = false;
  /** whether a texture is of the mesh, which it covers once */
  isCharted = false;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene.add(this.light, this.mesh);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.setShape("plane");
    this.setLook(FIRST_LOOK);
  }

  setLook(look: SceneLook): void {
    const { shape, around, above, exposure } = look;
    if (shape !== this.look.shape && !this.hasMesh) this.setShape(shape);
    const repeat = this.isCharted ? 1 : look.repeat;
    this.look = look;
    const [a, b] = [(around * Math.PI) / 180, (above * Math.PI) / 180];
    this.light.position.set(Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.sin(b)).multiplyScalar(5);
    this.light.intensity = LIGHT * 2 ** exposure;
    this.scene.environmentIntensity = AROUND_LIGHT * 2 ** exposure;
    this.textures.forEach((texture) => texture.repeat.set(repeat, repeat));
    this.surround(a, b);
    this.raise();
    this.draw();
  }

  /** Put surroundings about it, whose light comes from where the other one does; what lies flat has them above it. */
  private surround(around: number, above: number): void {
    const { shape, surroundings: wanted } = this.look;
    if (this.surrounded !== wanted) {
      const generator = new PMREMGenerator(this.renderer);
      const texture = surroundings(wanted);
      this.around?.dispose();
      this.around = generator.fromEquirectangular(texture);
      [this.scene.environment, this.surrounded] = [this.around.texture, wanted];
      texture.dispose();
      generator.dispose();
    }
    const isFlat = !this.hasMesh && (shape === "plane" || shape === "cloth");
    if (isFlat) this.scene.environmentRotation.set(Math.PI / 2, 0, around, "ZYX");
    else this.scene.environmentRotation.set(0, -Math.atan2(Math.sin(above), Math.cos(around) * Math.cos(above)), 0);
  }

  /** Let heights stand out, their middle where the surface is. */
  private raise(): void {
    const { material } = this.mesh;
    const relief = this.hasMesh ? 0 : (SIDE * this.look.relief) / 100;
    if (!material.displacementMap) return;
    [material.displacementScale, material.displacementBias] = [relief, -relief / 2];
  }

  /** Show a mesh, whose middle is turned about. */
  setMesh(corners: Corners, isCharted = true): void {
    [this.hasMesh, this.isCharted] = [true, isCharted];
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
    [this.hasMesh, this.isCharted] = [false, false];
    this.mesh.scale.setScalar(1);
    this.mesh.position.set(0, 0, 0);
    this.mesh.geometry.dispose();
    this.mesh.geometry = shapeOf(shape);
    const [x, y, z] = { sphere: [0, 0, DISTANCE], cube: [1.5, 1.1, DISTANCE], plane: [0, -1.1, DISTANCE], cloth: [0, -1.1, DISTANCE], mesh: [1.4, 1.1, DISTANCE] }[shape];
    this.camera.position.set(x, y, z);
    this.controls.target.set(0, 0, 0);
    this.controls.update();
    this.draw();
  }

  /** Show other maps, when they are loaded and no others are wanted by then; whether they are shown. */
  async setMaps(maps: Maps): Promise<boolean> {
    this.wanted = maps;
    const loader = new TextureLoader();
    const loaded = async (map: Maps[string]) => (typeof map === "string" ? loader.loadAsync(map) : new CanvasTexture(map as HTMLCanvasElement));
    const entries = await Promise.all(Object.entries(maps).map(async ([role, map]) => [role, await loaded(map)] as const));
    if (this.wanted !== maps) {
      entries.forEach(([, texture]) => texture.dispose());
      return false;
    }
    this.textures.forEach((texture) => texture.dispose());
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
      metalness: of("metallic") ? 1 : 0, aoMap: of("ao"), displacementMap: of("height"),
    });
    if (of("normal_dx")) material.normalScale = new Vector2(1, -1);
    else if (!of("normal") && of("height")) {
      material.bumpMap = of("height");
      material.bumpScale = 2;
    }
    this.mesh.material.dispose();
    this.mesh.material = material;
    this.setLook(this.look);
    return true;
  }

  draw(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.fov = (2 * Math.atan(Math.tan((FIELD * Math.PI) / 360) / Math.min(1, width / height)) * 180) / Math.PI;
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }

  dispose(): void {
    this.textures.forEach((texture) => texture.dispose());
    this.mesh.geometry.dispose();
    this.around?.dispose();
    this.controls.dispose();
    this.renderer.dispose();
  }
}

function shapeOf(shape: Shape): BufferGeometry {
  if (shape === "sphere") return new SphereGeometry(0.8, SEGMENTS, SEGMENTS / 2);
  if (shape === "cube") return new BoxGeometry(1.1, 1.1, 1.1, SEGMENTS, SEGMENTS, SEGMENTS);
  const geometry = new PlaneGeometry(SIDE, SIDE, SEGMENTS, SEGMENTS);
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
