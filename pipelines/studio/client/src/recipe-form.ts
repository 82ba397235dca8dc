// The params of a texture: method, size, tiling, seed, preset, uniformity.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import { presetName, tilingField } from "./fields";
import "./map-painter";
import "./method-controls";
import type { Method, Picture, Recipe } from "./messages";
import { methodName } from "./method-names";
import { SEED } from "./recipe-edits";
import "./several-pictures";
import { sides, sizeText } from "./sizes";
import type { Studio } from "./studio";

const SIZES = [256, 512, 1024, 2048, 4096];
const MOST_UNIFORM = 100;

/** Tells `edit` with the fields of a recipe that change. */
@customElement("recipe-form")
export class RecipeForm extends Element {
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) method!: Method;
  @property({ attribute: false }) methods: Method[] = [];
  @property({ attribute: false }) pictures: readonly Picture[] = [];
  /** where maps can be painted */
  @property({ attribute: false }) studio: Studio | null = null;
  /** the source that is being painted */
  @state() private painting = "";

  override render(): TemplateResult {
    const { recipe, method } = this;
    return html`
      ${this.methods.length
        ? html`<label class="field">
              <span>Method</span>
              <select aria-label="Method" .value=${recipe.flow} @change=${(event: Event) => this.edit({ flow: value(event) })}>
                ${this.methods.map((one) => html`<option value=${one.flow} ?selected=${one.flow === recipe.flow}>${methodName(one.flow)}</option>`)}
              </select>
            </label>
            <p class="hint">${method.about}</p>`
        : nothing}
      ${method.several
        ? html`<several-pictures .recipe=${recipe} .method=${method} .pictures=${this.pictures}></several-pictures>`
        : nothing}
      ${this.othersFields()}
      <method-controls .recipe=${recipe} .method=${method}></method-controls>
      ${method.size ? this.size(method.size) : nothing}
      ${method.can_tile
        ? tilingField(recipe.tileable ?? (method.tiles ? "both" : "off"), (one) => this.edit({ tileable: one === "off" && !method.tiles ? null : one }))
        : nothing}
      <div class="field">
        <span>Seed</span>
        <span class="pair">
          <input type="number" aria-label="Seed" min="0" step="1" .value=${String(recipe.seed ?? SEED)}
            @change=${(event: Event) => this.edit({ seed: Math.max(0, Math.trunc(Number(value(event)) || 0)) })} />
          <button title="Another seed (N)" @click=${() => this.edit({ seed: (recipe.seed ?? SEED) + 1 })}>Next</button>
        </span>
      </div>
      ${method.presets.length
        ? html`<label class="field">
            <span>Preset</span>
            <select aria-label="Preset" @change=${(event: Event) => this.edit({ preset: value(event) })}>
              ${method.presets.map((one) => html`<option value=${one} ?selected=${one === (recipe.preset ?? "default")}>${presetName(one)}</option>`)}
            </select>
          </label>`
        : nothing}
      ${method.uniformity ? this.uniformity() : nothing}
    `;
  }

  private size(usual: string): TemplateResult {
    const [height, width] = sides(this.recipe.size ?? usual);
    return html`<div class="field">
        <span>Size, px</span>
        <span class="pair">
          <input type="number" aria-label="Width" min="16" max="32768" step="1" .value=${String(width)}
            @change=${(event: Event) => this.edit({ size: sizeText([height, pixels(event, width)]) })} />
          ×
          <input type="number" aria-label="Height" min="16" max="32768" step="1" .value=${String(height)}
            @change=${(event: Event) => this.edit({ size: sizeText([pixels(event, height), width]) })} />
        </span>
      </div>
      <div class="chips" role="group" aria-label="Common sizes">
        ${SIZES.map((side) => html`<button aria-pressed=${height === side && width === side}
          @click=${() => this.edit({ size: sizeText([side, side]) })}>${side}</button>`)}
      </div>`;
  }

  /** The pictures besides the exemplars. */
  private othersFields(): TemplateResult[] {
    const { recipe, method } = this;
    return method.others.map(({ source, about, is_required, painted }) => {
      const chosen = String(recipe.sources[source] ?? "");
      const isPainted = chosen !== "" && this.pictures.every((one) => one.id !== chosen);
      return html`<label class="field"><span>${about}</span>
        <select aria-label=${about} @change=${(event: Event) => this.edit({ sources: this.withOther(source, value(event)) })}>
          <option value="" ?selected=${!chosen}>${is_required ? "choose …" : "none"}</option>
          ${isPainted ? html`<option value=${chosen} selected>painted</option>` : nothing}
          ${this.pictures.map((one) => html`<option value=${one.id} ?selected=${one.id === chosen}>${one.name}</option>`)}
        </select></label>
        ${painted && this.studio ? this.painter(source, about, chosen, painted) : nothing}`;
    });
  }

  private painter(source: string, about: string, chosen: string, ends: [string, string]): TemplateResult {
    const isOpen = this.painting === source;
    return html`<button aria-expanded=${isOpen} @click=${() => (this.painting = isOpen ? "" : source)}>
        ${isOpen ? "End painting" : `Paint ${about.toLowerCase()}`}</button>
      ${isOpen
        ? html`<map-painter .studio=${this.studio!} .size=${sides(this.recipe.size ?? this.method.size ?? "1")} .chosen=${chosen} .ends=${ends}
            @painted=${(event: CustomEvent<string>) => this.edit({ sources: this.withOther(source, event.detail) })}></map-painter>`
        : nothing}`;
  }

  /** The weight of spatial uniformity on a scale where its default is in the middle. */
  private uniformity(): TemplateResult {
    const { recipe, method } = this;
    const weight = Number(recipe.params?.[method.uniformity] ?? method.default_uniformity);
    const shown = Math.round(50 * Math.sqrt(weight / (method.default_uniformity || 10)));
    return html`<label class="field wide">
      <span>Uniformity <em>${Math.round(weight * 10) / 10}</em></span>
      <input type="range" aria-label="Uniformity" min="0" max=${MOST_UNIFORM} .value=${String(Math.min(MOST_UNIFORM, shown))}
        @change=${(event: Event) => this.edit({ params: this.weighted(Number(value(event))) })} />
      <span class="ends"><span>free repetition</span><span>everything used alike</span></span>
    </label>`;
  }

  private weighted(shown: number): Recipe["params"] {
    const { recipe, method } = this;
    const weight = Math.round(10 * (shown / 50) ** 2 * (method.default_uniformity || 10)) / 10;
    const { [method.uniformity]: _, ...others } = recipe.params ?? {};
    return weight === method.default_uniformity ? others : { ...others, [method.uniformity]: weight };
  }

  private withOther(source: string, id: string): Recipe["sources"] {
    const { [source]: _, ...sources } = this.recipe.sources;
    return id ? { ...sources, [source]: id } : sources;
  }

  private edit(change: Partial<Recipe>): void {
    this.tell("edit", change);
  }
}

const value = (event: Event): string => (event.target as HTMLInputElement).value;
const pixels = (event: Event, before: number): number => {
  const side = Math.trunc(Number(value(event)));
  return side >= 16 && side <= 32768 ? side : before;
};
