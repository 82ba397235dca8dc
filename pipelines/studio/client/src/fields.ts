// Parts of forms.
import { html, type TemplateResult } from "lit";
import { repeat } from "lit/directives/repeat.js";
import type { Recipe } from "./messages";

/** Whether keys are typed into something, instead of being commands. */
export const isTyping = ({ target }: Event): boolean =>
  target instanceof HTMLElement && ["INPUT", "SELECT", "TEXTAREA"].includes(target.tagName) && (target as HTMLInputElement).type !== "range";

/** A whole number on a scale from 0. */
export const slider = (label: string, value: number, most: number, set: (value: number) => void): TemplateResult => html`
  <label class="field wide">
    <span>${label} <em>${value}</em></span>
    <input type="range" min="0" max=${most} .value=${String(value)} aria-label=${label}
      @input=${(event: Event) => set(Number((event.target as HTMLInputElement).value))} />
  </label>`;

const MOST_CODE = 255;
/** A grey level as a share. */
export const amount = (label: string, code: number, set: (code: number) => void): TemplateResult => html`
  ${slider(`${label}, %`, Math.round((100 * code) / MOST_CODE), 100, (percent) => set(Math.round((MOST_CODE * percent) / 100)))}`;

/** Why something failed, with a button that tries it again. */
export const failure = (problem: string, again: () => void): TemplateResult =>
  html`${problem} <button class="quiet" @click=${again}>Try again</button>`;

/** Buttons of which one is chosen. */
export const choice = <Key extends string>(
  label: string, names: Record<Key, string>, chosen: Key, choose: (key: Key) => void,
): TemplateResult => html`<div class="segments" role="radiogroup" aria-label=${label}>
  ${repeat(Object.keys(names) as Key[], (key) => key, (key) => html`<button role="radio" aria-checked=${key === chosen}
    @click=${() => choose(key)}>${names[key]}</button>`)}
</div>`;

const PRESETS: Record<string, string> = { default: "usual", fast: "quick", kaspar2015: "as published" };
/** What a preset is called. */
export const presetName = (preset: string): string => PRESETS[preset] ?? preset;

/** The borders across which a texture continues. */
export type Tiling = NonNullable<Recipe["tileable"]>;
const TILINGS: Record<Tiling, string> = { off: "no", both: "both ways", x: "left to right", y: "top to bottom" };

/** A choice of borders; none given means `off`. */
export const tilingField = (chosen: Tiling | null | undefined, choose: (tiling: Tiling) => void): TemplateResult => html`
  <label class="field"><span>Tileable</span>
    <select aria-label="Tileable" @change=${(event: Event) => choose((event.target as HTMLSelectElement).value as Tiling)}>
      ${Object.entries(TILINGS).map(([one, label]) => html`<option value=${one} ?selected=${one === (chosen ?? "off")}>${label}</option>`)}
    </select></label>`;

/** A step of making a material, which can be folded; folded too one is told what was decided. */
export const card = (title: string, told: string, isOpen: boolean, body: unknown): TemplateResult => html`
  <details class="card" aria-label=${title} ?open=${isOpen}>
    <summary><strong>${title}</strong> <span>${told}</span></summary>
    <div class="more">${body}</div>
  </details>`;

/** A choice of a mesh, or of a file with one. */
export const meshFields = (
  meshes: readonly string[], chosen: string, suffixes: readonly string[], choose: (mesh: string) => void, take: (file: File) => void,
): TemplateResult => html`
  <label class="field"><span>Mesh</span><select aria-label="Mesh" @change=${(event: Event) => choose((event.target as HTMLSelectElement).value)}>
    ${meshes.map((one) => html`<option value=${one} ?selected=${one === chosen}>${one.replace(/^(texloom:|folder:|dropped:[^/]*\/)/, "")}</option>`)}
  </select></label>
  <label class="button">Choose a mesh file<input type="file" accept=${suffixes.join()} aria-label="Choose a mesh file"
    @change=${(event: Event) => {
      const [file] = (event.target as HTMLInputElement).files ?? [];
      if (file) take(file);
    }} /></label>`;

/** Buttons that step back and forth; the page clicks them for Ctrl+Z and Ctrl+Shift+Z. */
export const undoButtons = (
  history: { canUndo: boolean; canRedo: boolean }, step: (direction: "undo" | "redo") => void,
): TemplateResult => html`
  <button class="quiet" data-step="undo" title="Undo (Ctrl+Z)" aria-label="Undo" ?disabled=${!history.canUndo} @click=${() => step("undo")}>↶</button>
  <button class="quiet" data-step="redo" title="Redo (Ctrl+Shift+Z)" aria-label="Redo" ?disabled=${!history.canRedo} @click=${() => step("redo")}>↷</button>`;
