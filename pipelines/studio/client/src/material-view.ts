// A material on a shape, with a light to move.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Element } from "./element";
import { choice } from "./fields";
import type { Maps, MaterialScene } from "./scene";
import { FIRST_LOOK, type SceneLook, type Shape } from "./scene-look";
import { mesh } from "./server";
import type { Studio } from "./studio";

const SHAPES: Record<Shape, string> = { plane: "Plane", sphere: "Sphere", cube: "Cube", cloth: "Cloth" };

@customElement("material-view")
export class MaterialView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) maps: Maps = {};
  /** id of a mesh on which the material is, and the size of its texture; none: shapes to choose from */
  @property() mesh = "";
  @property({ type: Number }) side = 1024;
  @state() private look = FIRST_LOOK;
  @query("canvas") private canvas!: HTMLCanvasElement;
  private scene: MaterialScene | null = null;
  private readonly observer = new ResizeObserver(() => this.scene?.draw());

  protected override async firstUpdated(): Promise<void> {
    this.observer.observe(this.canvas);
    const { MaterialScene } = await import("./scene");
    if (!this.isConnected) return;
    this.scene = new MaterialScene(this.canvas);
    this.scene.setLook(this.look);
    this.load();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
    this.scene?.dispose();
  }

  protected override updated(changed: Map<string, unknown>): void {
    if (changed.has("maps") || changed.has("mesh")) this.load();
    if (changed.has("look")) this.scene?.setLook(this.look);
  }

  private load(): void {
    if (this.scene && Object.keys(this.maps).length) {
      void this.studio.attempt(this.show(this.scene));
    }
  }

  private async show(scene: MaterialScene): Promise<void> {
    if (this.mesh) scene.setMesh(await mesh(this.mesh, this.side));
    else if (scene.hasMesh) scene.setShape(this.look.shape);
    if (await scene.setMaps(this.maps)) this.setAttribute("ready", "");
  }

  override render(): TemplateResult {
    const { look, mesh } = this;
    const see = (change: Partial<SceneLook>): void => {
      this.look = { ...look, ...change };
    };
    const slider = (label: string, name: Exclude<keyof SceneLook, "shape">, least: number, most: number, step = 1) => html`
      <label>${label}
        <input type="range" min=${least} max=${most} step=${step} .value=${String(look[name])} aria-label=${label}
          @input=${(event: Event) => see({ [name]: Number((event.target as HTMLInputElement).value) })} />
      </label>`;
    return html`
      <canvas role="img" aria-label="Material, lit. Drag to turn it" tabindex="0"></canvas>
      <div class="float">
        ${mesh ? nothing : choice("Shape", SHAPES, look.shape, (shape) => see({ shape }))}
        <details>
          <summary>Light and relief</summary>
          <div class="sliders">
            ${slider("Light around", "around", 0, 360)}
            ${slider("Light above", "above", 0, 90)}
            ${slider("Exposure", "exposure", -3, 3, 0.25)}
            ${mesh ? nothing : slider("Tiling", "repeat", 1, 6)}
            ${mesh || !("height" in this.maps) ? nothing : slider("Relief", "relief", 0, 20)}
          </div>
        </details>
      </div>
    `;
  }
}
