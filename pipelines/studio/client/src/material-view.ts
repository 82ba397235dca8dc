// A material on a shape, with a light to move.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Element } from "./element";
import type { Maps, MaterialScene, Shape } from "./scene";
import { mesh } from "./server";
import type { Studio } from "./studio";

const SHAPES: Record<Shape, string> = { plane: "Plane", sphere: "Sphere", cloth: "Cloth" };

@customElement("material-view")
export class MaterialView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) maps: Maps = {};
  /** id of a mesh on which the material is, and the size of its texture; none: shapes to choose from */
  @property() mesh = "";
  @property({ type: Number }) side = 1024;
  @state() private shape: Shape = "plane";
  @state() private repeat = 1;
  @state() private around = 45;
  @state() private above = 50;
  @query("canvas") private canvas!: HTMLCanvasElement;
  private scene: MaterialScene | null = null;
  private readonly observer = new ResizeObserver(() => this.scene?.draw());

  protected override async firstUpdated(): Promise<void> {
    this.observer.observe(this.canvas);
    const { MaterialScene } = await import("./scene");
    this.scene = new MaterialScene(this.canvas);
    this.load();
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
    this.scene?.dispose();
  }

  protected override updated(changed: Map<string, unknown>): void {
    if (changed.has("maps") || changed.has("mesh")) this.load();
  }

  private load(): void {
    if (this.scene && Object.keys(this.maps).length) {
      void this.studio.attempt(this.show(this.scene));
    }
  }

  private async show(scene: MaterialScene): Promise<void> {
    if (this.mesh) scene.setMesh(await mesh(this.mesh, this.side));
    else if (scene.hasMesh) scene.setShape(this.shape);
    await scene.setMaps(this.maps, this.mesh ? 1 : this.repeat);
    this.setAttribute("ready", "");
  }

  override render(): TemplateResult {
    const slider = (label: string, value: number, most: number, set: (value: number) => void, least = 0) => html`
      <label>${label}
        <input type="range" min=${least} max=${most} .value=${String(value)} aria-label=${label}
          @input=${(event: Event) => set(Number((event.target as HTMLInputElement).value))} />
      </label>`;
    return html`
      <canvas role="img" aria-label="Material, lit. Drag to turn it" tabindex="0"></canvas>
      <div class="float">
        <div class="segments" role="radiogroup" aria-label="Shape" ?hidden=${!!this.mesh}>
          ${(Object.keys(SHAPES) as Shape[]).map((shape) => html`<button role="radio" aria-checked=${shape === this.shape}
            @click=${() => {
              this.shape = shape;
              this.scene?.setShape(shape);
            }}>${SHAPES[shape]}</button>`)}
        </div>
        ${this.mesh ? nothing : slider("Repeat", this.repeat, 6, (value) => {
          this.repeat = value;
          this.scene?.setRepeat(value);
        }, 1)}
        ${slider("Light around", this.around, 360, (value) => this.lit(value, this.above))}
        ${slider("Light above", this.above, 90, (value) => this.lit(this.around, value))}
      </div>
    `;
  }

  private lit(around: number, above: number): void {
    [this.around, this.above] = [around, above];
    this.scene?.setLight(around, above);
  }
}
