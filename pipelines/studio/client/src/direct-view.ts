// Direct: what lies where in a texture, by painted layers, a collage, or the lattice of the exemplar.
import { html, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import "./direct-collage";
import "./direct-lattice";
import type { ModeName } from "./direct-mode";
import "./direct-paint";
import { Element } from "./element";
import type { Picture } from "./messages";
import "./picture-list";
import type { Studio } from "./studio";

@customElement("direct-view")
export class DirectView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @state() private picture: Picture | null = null;
  @state() private mode: ModeName = "paint";

  override render(): TemplateResult {
    return html`
      <aside class="left" aria-label="Exemplars">
        <picture-list .studio=${this.studio} .chosen=${this.picture?.id ?? ""}
          @choose=${(event: CustomEvent<Picture>) => (this.picture = event.detail)}></picture-list>
      </aside>
      ${this.picture ? this.modes(this.picture) : html`<section class="stage wide" aria-label="Direct"><div class="welcome">
        <h2>Direct a texture</h2>
        <p>Choose an exemplar. Paint what must not be used, what lies where and along which lines it runs; lay pieces of it as a
          collage; or straighten its lattice.</p></div></section>`}
    `;
  }

  private modes(picture: Picture): TemplateResult {
    const mode = (event: CustomEvent<ModeName>): void => {
      this.mode = event.detail;
    };
    return html`
      <direct-paint .studio=${this.studio} .picture=${picture} ?hidden=${this.mode !== "paint"} @mode=${mode}></direct-paint>
      <direct-collage .studio=${this.studio} .picture=${picture} ?hidden=${this.mode !== "collage"} @mode=${mode}></direct-collage>
      <direct-lattice .studio=${this.studio} .picture=${picture} ?hidden=${this.mode !== "lattice"} @mode=${mode}></direct-lattice>
    `;
  }
}
