// Make: textures of one picture or of several, with a preview that follows every change.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query } from "lit/decorators.js";
import { keyed } from "lit/directives/keyed.js";
import type { CorrectPanel } from "./correct-panel";
import "./correct-panel";
import { Element } from "./element";
import { failure } from "./fields";
import { hasPreview, type LayerName } from "./layers";
import { MakeMaterial } from "./make-material";
import type { Shown } from "./make-modes";
import "./make-settings";
import { waitsFor } from "./make-status";
import "./make-stage";
import "./material-bar";
import "./material-layers";
import type { Picture, Recipe, Variant } from "./messages";
import "./picture-list";
import type { Patch, Point } from "./picture-view";
import { picturesOf } from "./recipe-edits";
import { screenPixels } from "./sizes";
import type { Studio } from "./studio";
import type { Cell, Kind } from "./variants";
import { welcome } from "./welcome";

@customElement("make-view")
export class MakeView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @query("correct-panel") private panel!: CorrectPanel;
  private made!: MakeMaterial;

  private readonly make = (recipe: Recipe) => this.made.make(recipe);

  override connectedCallback(): void {
    super.connectedCallback();
    this.made ??= new MakeMaterial(this.studio, () => screenPixels(this.shownStage), () => this.requestUpdate());
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  /** That of the result, or of the layer that is being left. */
  private get shownStage(): HTMLElement | null {
    return [...this.querySelectorAll<HTMLElement>(".stage")].find((one) => one.checkVisibility()) ?? null;
  }

  /** Draw on the material that is open, if there is one. */
  open(layer: LayerName): void {
    if (this.made.recipe) this.made.showLayer(layer);
  }

  override render(): TemplateResult {
    const { made } = this;
    const { recipe, state: { layer } } = made;
    const picture = this.studio.picture(picturesOf(recipe)[0]);
    return html`
      <aside class="left" aria-label="Pictures">
        <picture-list .studio=${this.studio} .chosen=${picturesOf(recipe)} .takesSeveral=${made.method.several !== null && recipe !== null}
          @choose=${(event: CustomEvent<Picture>) => made.choose(event.detail)}
          @add=${(event: CustomEvent<Picture>) => made.choose(event.detail, true)}></picture-list>
      </aside>
      <material-bar .studio=${this.studio}></material-bar>
      <section class="stage" aria-label="Texture" ?hidden=${layer !== "result"}>
        ${recipe ? this.stage() : welcome(this.studio.begin.examples[0], (picture) => made.choose(picture))}
        ${this.studio.incoming ? html`<picture-view class="incoming" label="Picture that is being read" .picture=${this.studio.incoming}></picture-view>` : nothing}
      </section>
      ${picture ? keyed(made.opened, html`<material-layers .studio=${this.studio} .picture=${picture} .recipe=${recipe}
        .begun=${made.results.picture ?? made.previews.picture} .make=${this.make} .layer=${layer}
        @layer=${(event: CustomEvent<LayerName>) => made.showLayer(event.detail)}
        @drawn=${(event: CustomEvent<Recipe>) => made.draw(event.detail)}></material-layers>`) : nothing}
      <material-results .studio=${this.studio} .shown=${made.results.id} .against=${made.other.job} ?hidden=${made.state.isCorrecting}
        @result=${(event: CustomEvent<Variant>) => made.goBack(event.detail)}
        @against=${(event: CustomEvent<string>) => made.compare(event.detail)}></material-results>
      <aside class="right" aria-label="Settings" ?hidden=${layer !== "result"}>${recipe ? this.settings(recipe) : nothing}</aside>
    `;
  }

  private stage(): TemplateResult {
    const { recipe, method, results, previews, state } = this.made;
    const { problem } = previews;
    return html`<make-stage .studio=${this.studio} .recipe=${recipe} .method=${method} .results=${results} .history=${this.made.history}
      .mode=${state.mode} .modes=${this.made.modes} .file=${this.made.shownFile} .sheet=${previews.sheet} .other=${this.made.other}
      .preview=${previews.picture} .previewScale=${previews.scale} .exemplar=${previews.exemplar} .exemplarTiles=${previews.exemplarTiles} .done=${previews.done}
      .status=${problem ? failure(problem, () => previews.again()) : this.made.status}
      .waits=${problem || waitsFor(this.made.lacking, results, hasPreview(method))}
      .isCorrecting=${state.isCorrecting} .outline=${state.outline} .patch=${state.patch}
      @mode=${(event: CustomEvent<Shown>) => this.made.chooseMode(event.detail)}
      @step=${(event: CustomEvent<"undo" | "redo">) => this.made.step(event.detail)}
      @file=${(event: CustomEvent<string>) => this.made.chooseFile(event.detail)}
      @vary=${(event: CustomEvent<Kind>) => this.made.vary(event.detail)}
      @take=${(event: CustomEvent<Cell>) => this.made.take(event.detail)}
      @blend=${(event: CustomEvent<Variant[]>) => this.made.blend(event.detail)}
      @lasso=${(event: CustomEvent<Point[]>) => {
        this.made.see({ outline: event.detail });
        void this.panel.begin(event.detail);
      }}></make-stage>`;
  }

  private settings(recipe: Recipe): TemplateResult {
    const { made } = this;
    const { job, picture, places, isWhole, size } = made.results;
    if (made.state.isCorrecting && job && picture) {
      return html`<correct-panel .studio=${this.studio} .job=${job} .places=${places} .size=${size}
        @outline=${(event: CustomEvent<Point[]>) => made.see({ outline: event.detail })}
        @patch=${(event: CustomEvent<Patch | null>) => made.see({ patch: event.detail })}
        @accept=${(event: CustomEvent<Recipe | null>) => made.accept(event.detail)}></correct-panel>`;
    }
    return html`<make-settings .studio=${this.studio} .recipe=${recipe} .method=${made.method} .job=${job} .isWhole=${isWhole} .lacking=${made.lacking}
      @edit=${(event: CustomEvent<Partial<Recipe>>) => made.edit(event.detail)}
      @layer=${(event: CustomEvent<LayerName>) => made.showLayer(event.detail)} @undraw=${() => made.undraw()}
      @finish=${() => made.finish()} @correct=${() => made.correct()}></make-settings>`;
  }
}
