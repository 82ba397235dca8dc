// The layers of the material that is open. One that was opened keeps what is drawn on it until another material is.
import type { TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { html, literal } from "lit/static-html.js";
import "./direct-collage";
import "./direct-lattice";
import "./direct-paint";
import { Element } from "./element";
import type { LayerName } from "./layers";
import type { MaterialLayer } from "./material-layer";
import "./mesh-view";
import type { Picture, Recipe } from "./messages";
import "./paint-view";
import "./photograph-view";
import type { Drawable } from "./picture-view";
import type { Studio } from "./studio";

const ELEMENTS = {
  guides: literal`direct-paint`, collage: literal`direct-collage`, lattice: literal`direct-lattice`, paint: literal`paint-view`,
  mesh: literal`mesh-view`, surfaces: literal`photograph-view`,
};

@customElement("material-layers")
export class MaterialLayers extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) picture!: Picture;
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) begun: Drawable | null = null;
  @property({ attribute: false }) make!: MaterialLayer["make"];
  /** the one that is shown */
  @property() layer: LayerName = "result";
  private readonly opened = new Set<keyof typeof ELEMENTS>();

  protected override willUpdate(): void {
    if (this.layer !== "result") this.opened.add(this.layer);
  }

  override render(): TemplateResult {
    return html`${[...this.opened].map((one) => html`<${ELEMENTS[one]} .studio=${this.studio} .picture=${this.picture} .recipe=${this.recipe}
      .begun=${this.begun} .make=${this.make} ?hidden=${this.layer !== one}></${ELEMENTS[one]}>`)}` as TemplateResult;
  }
}
