// What is beside a photograph: the areas that are painted on it, and what is made of it.
import { html, nothing, type TemplateResult } from "lit";
import { choice, tilingField } from "./fields";
import type { Photo } from "./photo";
import { type Brush } from "./photo-canvas";
import type { PhotoDocument } from "./photo-document";
import { type Purpose, PURPOSES, type Settings } from "./photo-flows";

export const AREAS = { region: "Region", without: "Without", hole: "Hole", "features.joints": "Joints" } as const;
export type Area = keyof typeof AREAS;
const ABOUT: Record<Area, string> = {
  region: "Where texture is taken from. Unpainted: all that patches cover.",
  without: "What lies in front and is not taken.",
  hole: "What is filled or covered.",
  "features.joints": "Joints of bricks or tiles, which keep elements whole.",
};
const TOOLS: Record<Brush["tool"], string> = { stroke: "Brush", outline: "Outline", fill: "Fill", features: "Threshold" };
const BRUSHES: Record<Brush["tool"], Partial<Brush>> = {
  stroke: { radius: 24 }, outline: {}, fill: { tolerance: 8 }, features: { radius: 12, tolerance: 4 },
};

/** Areas, and how they are painted; `mark` marks features in all of it. */
export function areasSide(
  document: PhotoDocument, area: Area, brush: Required<Brush>,
  tell: { area: (area: Area) => void; brush: (brush: Required<Brush>) => void; mark: () => void; clear: () => void },
): TemplateResult {
  const set = (change: Partial<Brush>) => tell.brush({ ...brush, ...change } as Required<Brush>);
  const usesRadius = ["stroke", "features"].includes(brush.tool);
  return html`
    ${choice("Area", AREAS, area, tell.area)}
    <p class="hint">${ABOUT[area]}</p>
    ${choice("Tool", TOOLS, brush.tool, (tool) => set({ tool, ...BRUSHES[tool] }))}
    ${choice("Paint or erase", { add: "Add", erase: "Erase" }, brush.erase ? "erase" : "add", (one) => set({ erase: one === "erase" }))}
    ${usesRadius ? slider(brush.tool === "stroke" ? "Brush radius" : "Width, px", brush.radius, 1, 128, String(brush.radius), (radius) => set({ radius })) : nothing}
    ${brush.tool === "fill" || brush.tool === "features"
      ? slider("Threshold", brush.tolerance, 0, 40, String(brush.tolerance), (tolerance) => set({ tolerance })) : nothing}
    ${brush.tool === "fill" ? html`<p class="hint">Click a place: what is connected to it and looks like it is filled.</p>` : nothing}
    ${brush.tool === "features"
      ? html`${choice("What is marked", { dark: "Dark", bright: "Bright", both: "Both" }, brush.features, (features) => set({ features }))}
          <button @click=${tell.mark}>Mark in the whole photograph</button>`
      : nothing}
    <button ?disabled=${!document.areas[area]} @click=${tell.clear}>Clear ${AREAS[area].toLowerCase()}</button>
  `;
}

/** What is made of it; ``scenes`` are photographs with holes into which it may be placed. */
export function makeSide(settings: Settings, scenes: Photo[], tell: (settings: Settings) => void): TemplateResult {
  const set = (change: Partial<Settings>) => tell({ ...settings, ...change });
  const purpose = PURPOSES[settings.purpose];
  return html`
    ${choice("What to make", labels(), settings.purpose, (one) => set({ purpose: one }))}
    <p class="hint">${purpose.about}</p>
    ${purpose.hasSize
      ? html`<label class="field"><span>Size, px</span><input type="number" min="64" max="8192" step="1" .value=${String(settings.side)}
            aria-label="Size" @change=${(event: Event) => set({ side: whole(event, 64, settings.side) })} /></label>
          ${tilingField(settings.tileable, (one) => set({ tileable: one }))}`
      : nothing}
    ${settings.purpose === "place"
      ? scenes.length
        ? html`<label class="field"><span>Into</span><select aria-label="Other photograph" @change=${(event: Event) => set({ scene: (event.target as HTMLSelectElement).value })}>
            <option value="">choose</option>
            ${scenes.map((one) => html`<option value=${one.picture.id} ?selected=${one.picture.id === settings.scene}>${one.picture.name}</option>`)}</select></label>`
        : html`<p class="hint">First open the other photograph, place a plane on it and paint its hole.</p>`
      : nothing}
    <label class="field"><span>Seed</span><input type="number" min="0" step="1" aria-label="Seed" .value=${String(settings.seed)}
      @change=${(event: Event) => set({ seed: whole(event, 0, settings.seed) })} /></label>
  `;
}

const labels = (): Record<Purpose, string> =>
  Object.fromEntries(Object.entries(PURPOSES).map(([name, one]) => [name, one.short])) as Record<Purpose, string>;

export const slider = (
  label: string, value: number, least: number, most: number, shown: string, set: (value: number) => void,
): TemplateResult => html`<label class="field wide"><span>${label} <em>${shown}</em></span>
  <input type="range" min=${least} max=${most} .value=${String(value)} aria-label=${label}
    @change=${(event: Event) => set(Number((event.target as HTMLInputElement).value))} /></label>`;

const whole = (event: Event, least: number, before: number): number => {
  const value = Math.trunc(Number((event.target as HTMLInputElement).value));
  return value >= least ? value : before;
};
