// A material on a shape or a mesh, with a light to move and surroundings to choose.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Element } from "./element";
import { choice, meshFields } from "./fields";
import type { Maps, MaterialScene } from "./scene";
import { FIRST_LOOK, type SceneLook, SHAPES, SURROUNDINGS, type Surroundings } from "./scene-look";
import { mesh } from "./server";
import type { Studio } from "./studio";

const SIDE = 1024; // px, for the texture coordinates of a mesh that has none

@customElement("material-view")
export class MaterialView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) maps: Maps = {};
  /** id of the mesh that the texture covers, and the size of that; none: shapes to choose from */
  @property() mesh = "";
  @property({ type: Number }) side = SIDE;
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
    const before = changed.get("look") as SceneLook | undefined;
    const isOther = before && (before.shape !== this.look.shape || before.mesh !== this.look.mesh);
    if (before) this.scene?.setLook(this.look);
    if (changed.has("maps") || changed.has("mesh") || isOther) this.load();
  }

  private load(): void {
    if (this.scene && Object.keys(this.maps).length) {
      void this.studio.attempt(this.show(this.scene));
    }
  }

  /** The mesh that is looked at, which may be one of one's own. */
  private get shown(): string {
    return this.mesh || (this.look.shape === "mesh" ? this.look.mesh || this.studio.meshes[0] : "");
  }

  private async show(scene: MaterialScene): Promise<void> {
    const { shown } = this;
    const corners = shown && (await mesh(shown, this.mesh ? this.side : SIDE));
    if (shown !== this.shown) return; // another one was chosen meanwhile
    if (corners) scene.setMesh(corners, this.mesh !== "");
    else if (scene.hasMesh) scene.setShape(this.look.shape);
    if (await scene.setMaps(this.maps)) this.setAttribute("ready", "");
  }

  private async take(file: File): Promise<void> {
    const taken = await this.studio.takeMesh(file);
    if (taken) this.look = { ...this.look, mesh: taken };
  }

  override render(): TemplateResult {
    const { look, mesh } = this;
    const see = (change: Partial<SceneLook>): void => {
      this.look = { ...look, ...change };
    };
    const slider = (label: string, name: "around" | "above" | "exposure" | "repeat" | "relief", least: number, most: number, step = 1) => html`
      <label>${label}
        <input type="range" min=${least} max=${most} step=${step} .value=${String(look[name])} aria-label=${label}
          @input=${(event: Event) => see({ [name]: Number((event.target as HTMLInputElement).value) })} />
      </label>`;
    return html`
      <canvas role="img" aria-label="Material, lit. Drag to turn it" tabindex="0"></canvas>
      <div class="float">
        ${mesh ? nothing : choice("Shape", SHAPES, look.shape, (shape) => see({ shape }))}
        ${!mesh && look.shape === "mesh" ? meshFields(this.studio.meshes, this.shown, this.studio.begin.mesh_suffixes, (one) => see({ mesh: one }), (file) => void this.take(file)) : nothing}
        <details>
          <summary>Light and relief</summary>
          <div class="sliders">
            <label>Lit by <select aria-label="Surroundings" @change=${(event: Event) => see({ surroundings: (event.target as HTMLSelectElement).value as Surroundings })}>
              ${Object.entries(SURROUNDINGS).map(([one, name]) => html`<option value=${one} ?selected=${one === look.surroundings}>${name}</option>`)}
            </select></label>
            ${slider("Light around", "around", 0, 360)}
            ${slider("Light above", "above", 0, 90)}
            ${slider("Exposure", "exposure", -3, 3, 0.25)}
            ${mesh ? nothing : slider("Tiling", "repeat", 1, 6)}
            ${this.shown || !("height" in this.maps) ? nothing : slider("Relief", "relief", 0, 20)}
          </div>
        </details>
      </div>
    `;
  }
}
