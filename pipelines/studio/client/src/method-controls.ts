// What a method can be told besides size and seed: settings under a name, sliders and switches.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import type { Control, Method, Picker, Recipe, Setting } from "./messages";

const OWN = "own"; // of a choice whose params have other values
const COARSE = 30; // range from which a slider has whole numbers
const MOST_OPEN = 2; // sliders that are shown at once
const FINE_STEP = 0.05;
const NARROW = 0.25; // range below which steps are finer
const FINER_STEP = 0.001;
const stepOf = ({ least, most }: Control): number => (most - least > COARSE ? 1 : most - least < NARROW ? FINER_STEP : FINE_STEP);

/** Tells `edit` with the fields of a recipe that change. */
@customElement("method-controls")
export class MethodControls extends Element {
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) method!: Method;
  /** whose choices and sliders these are */
  @property() card: Control["card"] = "make";

  override render(): TemplateResult {
    const { controls } = this;
    const choices = this.method.choices.filter((one) => one.card === this.card);
    return html`
      ${choices.map((one) => (one.without && this.recipe.sources[one.without] ? nothing : this.choice(one)))}
      ${controls.length > MOST_OPEN ? html`<details><summary>More</summary><div class="more">${this.fields()}</div></details>` : this.fields()}
    `;
  }

  private get controls(): Control[] {
    return this.method.controls.filter((one) => one.card === this.card);
  }

  private fields(): TemplateResult[] {
    return this.controls.map((one) => (one.is_switch ? this.checkbox(one) : this.slider(one)));
  }

  private choice(one: Picker): TemplateResult {
    const active = activeOf(this.recipe, one);
    return html`<label class="field"><span>${one.label}</span>
      <select aria-label=${one.label} @change=${(event: Event) => this.take(one, one.settings[Number((event.target as HTMLSelectElement).value)])}>
        ${one.settings.map((setting, index) => html`<option value=${index} ?selected=${index === active}>${setting.name}</option>`)}
        ${active < 0 ? html`<option value=${OWN} selected disabled>as under More</option>` : nothing}
      </select></label>`;
  }

  private take(choice: Picker, { params, lists, udim }: Setting): void {
    const names = namesOf(choice);
    const kept = <Value>(given: Record<string, Value> = {}): Record<string, Value> =>
      Object.fromEntries(Object.entries(given).filter(([name]) => !names.includes(name)));
    const cuts = choice.settings.some((one) => one.udim);
    this.tell<Partial<Recipe>>("edit", {
      params: { ...kept(this.recipe.params), ...params },
      lists: { ...kept(this.recipe.lists), ...lists },
      ...(cuts ? { udim: udim || null } : {}),
    });
  }

  private slider(one: Control): TemplateResult {
    const now = Number(this.recipe.params?.[one.param] ?? one.default);
    return html`<label class="field wide">
      <span>${one.label} <em>${Number(now.toFixed(3))}</em></span>
      <input type="range" aria-label=${one.label} min=${one.least} max=${one.most}
        step=${stepOf(one)} .value=${String(now)}
        @change=${(event: Event) => this.set(one, Number((event.target as HTMLInputElement).value))} />
      <span class="ends"><span>${one.ends[0]}</span><span>${one.ends[1]}</span></span>
    </label>`;
  }

  private checkbox(one: Control): TemplateResult {
    return html`<label class="check"><input type="checkbox" .checked=${Boolean(this.recipe.params?.[one.param] ?? one.default)}
      @change=${(event: Event) => this.set(one, (event.target as HTMLInputElement).checked)} />${one.label}</label>`;
  }

  private set({ param, default: usual }: Control, value: number | boolean): void {
    const { [param]: _, ...others } = this.recipe.params ?? {};
    this.tell<Partial<Recipe>>("edit", { params: Number(value) === usual ? others : { ...others, [param]: value } });
  }
}

/** The number of the setting that a recipe has; -1: none of them. */
function activeOf(recipe: Recipe, choice: Picker): number {
  const same = (given: unknown, wanted: unknown): boolean => JSON.stringify(given) === JSON.stringify(wanted);
  return choice.settings.findIndex(({ params, lists }) =>
    namesOf(choice).every((name) => same(recipe.params?.[name], params[name]) && same(recipe.lists?.[name], lists[name])));
}

/** What has been decided by the choices of a card, in words; null: it has none. */
export function toldOf(recipe: Recipe, method: Method, card: Control["card"]): string | null {
  const choices = method.choices.filter((one) => one.card === card);
  if (!choices.length) return null;
  return choices.map((one) => `${one.label.toLowerCase()} ${one.settings[activeOf(recipe, one)]?.name ?? "as under More"}`).join(", ");
}

/** All params that some setting changes. */
const namesOf = ({ settings }: Picker): string[] => [
  ...new Set(settings.flatMap(({ params, lists }) => [...Object.keys(params), ...Object.keys(lists)])),
];
