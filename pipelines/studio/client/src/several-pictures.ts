// The pictures of which a method takes several: added, removed, put into another order, and used more or less.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { repeat } from "lit/directives/repeat.js";
import { Element } from "./element";
import type { Method, Picture, Recipe } from "./messages";
import { picturesOf, reordered } from "./recipe-edits";
import { pictureAddress } from "./server";

const THUMBNAIL = 128; // px, as of the list on the left
const MOST_WEIGHT = 8;

/** Tells `edit` with the fields of a recipe that change. */
@customElement("several-pictures")
export class SeveralPictures extends Element {
  @property({ attribute: false }) recipe!: Recipe;
  @property({ attribute: false }) method!: Method;
  @property({ attribute: false }) pictures: readonly Picture[] = [];
  /** what a screen reader is told of the last change */
  @state() private said = "";
  private focusing: (() => void) | null = null;

  override render(): TemplateResult {
    const [several, chosen] = [this.method.several!, picturesOf(this.recipe)];
    const others = this.pictures.filter((one) => !chosen.includes(one.id));
    return html`<section class="several" aria-label="Pictures of the texture">
      <ol>${repeat(chosen, (id) => id, (id, index) => this.entry(id, index, chosen))}</ol>
      ${chosen.length < several.most
        ? html`<label class="field"><span>Add</span>
            <select aria-label="Add a picture" .value=${""} @change=${(event: Event) => this.add(event.target as HTMLSelectElement)}>
              <option value="" selected>choose …</option>
              ${others.map((one) => html`<option value=${one.id}>${one.name}</option>`)}
            </select></label>`
        : nothing}
      ${this.weights
        ? html`<button @click=${() => this.weigh(null)}>Share by size again</button>`
        : nothing}
      <p class="hint">${several.least} to ${several.most} pictures; drop them, or click them on the left.</p>
      <p class="unseen" role="status">${this.said}</p>
    </section>`;
  }

  /** Where the focus goes once the list is another one. */
  protected override updated(changed: Map<string, unknown>): void {
    if (!changed.has("recipe")) return;
    this.focusing?.();
    this.focusing = null;
  }

  private entry(id: string, index: number, chosen: string[]): TemplateResult {
    const name = this.name(id);
    const several = this.method.several!;
    const role = index === 0 ? several.ends[0] : index === chosen.length - 1 ? several.ends[1] : "";
    const weight = this.weights?.[index];
    return html`<li data-id=${id}>
      <img src=${pictureAddress(id, THUMBNAIL)} alt="" draggable="false" />
      <span class="name">${name}${role ? html`<em>${role}</em>` : nothing}</span>
      ${several.is_ordered
        ? html`<button class="quiet" data-move="-1" aria-label="Move ${name} up" ?disabled=${index === 0} @click=${() => this.move(id, -1)}>↑</button>
            <button class="quiet" data-move="1" aria-label="Move ${name} down" ?disabled=${index === chosen.length - 1} @click=${() => this.move(id, 1)}>↓</button>`
        : nothing}
      <button class="quiet" aria-label="Remove ${name}" @click=${() => this.take(id)}>✕</button>
      ${several.weights
        ? html`<label class="share"><span>Share <em>${weight ?? "by size"}</em></span>
            <input type="range" min="1" max=${MOST_WEIGHT} .value=${String(weight ?? 1)} aria-label="Share of ${name}"
              @change=${(event: Event) => this.weigh(chosen.map((_, at) => (at === index ? Number((event.target as HTMLInputElement).value) : this.weights?.[at] ?? 1)))} /></label>`
        : nothing}
    </li>`;
  }

  private get weights(): number[] | undefined {
    return this.recipe.lists?.[this.method.several!.weights];
  }

  private name(id: string): string {
    return this.pictures.find((one) => one.id === id)?.name ?? id;
  }

  private add(select: HTMLSelectElement): void {
    const id = select.value;
    select.value = "";
    this.change([...picturesOf(this.recipe), id], `${this.name(id)} is added`);
  }

  private take(id: string): void {
    this.change(picturesOf(this.recipe).filter((one) => one !== id), `${this.name(id)} is removed`);
    this.focusing = () => this.querySelector<HTMLElement>("ol button:not(:disabled), select")?.focus();
  }

  /** Move a picture to an earlier or later place; the key that did it keeps the focus. */
  private move(id: string, by: number): void {
    const pictures = picturesOf(this.recipe);
    const from = pictures.indexOf(id);
    pictures.splice(from, 1);
    pictures.splice(from + by, 0, id);
    this.change(pictures, `${this.name(id)} is number ${from + by + 1} of ${pictures.length}`);
    this.focusing = () => {
      const buttons = [...this.querySelectorAll<HTMLButtonElement>("li button[data-move]")];
      const own = buttons.filter((one) => one.closest("li")!.dataset.id === id && !one.disabled);
      (own.find((one) => one.dataset.move === String(by)) ?? own[0])?.focus();
    };
  }

  private weigh(weights: number[] | null): void {
    const { [this.method.several!.weights]: _, ...lists } = this.recipe.lists ?? {};
    this.tell("edit", { lists: weights ? { ...lists, [this.method.several!.weights]: weights } : lists });
  }

  private change(pictures: string[], said: string): void {
    this.said = said;
    this.tell("edit", reordered(this.recipe, this.method, pictures));
  }
}
