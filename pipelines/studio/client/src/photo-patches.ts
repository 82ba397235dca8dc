// What is beside a photograph while its patches are placed.
import { html, nothing, type TemplateResult } from "lit";
import { surface } from "./bezier";
import { choice } from "./fields";
import type { PatchRecipe } from "./messages";
import { words } from "./method-names";
import type { Photo } from "./photo";
import { type Handle, type PhotoDocument, weighted } from "./photo-document";
import { slider } from "./photo-sides";
import { sides, sizeText } from "./sizes";

type Change = (patch: PatchRecipe) => PatchRecipe;
/** What a person does with patches; `points`: whether control points are dragged, `change`: the one that is chosen. */
interface Tell {
  propose: () => void;
  add: () => void;
  select: (name: string) => void;
  points: (isCurved: boolean) => void;
  change: (change: Change) => void;
  remove: () => void;
}

export function patchesSide(
  document: PhotoDocument, photo: Photo, { isProposing, isCurved, handle }: { isProposing: boolean; isCurved: boolean; handle: Handle | null }, tell: Tell,
): TemplateResult {
  const patch = document.patches.find((one) => one.name === photo.patch);
  return html`
    <p class="row"><button class="half" ?disabled=${isProposing} @click=${tell.propose}>Propose planes</button>
      <button class="half" @click=${tell.add}>Add a plane</button></p>
    <ul class="list" aria-label="Patches">${document.patches.map((one) => {
      const problem = photo.described.get(one.name)?.problem;
      return html`<li><button class=${problem ? "bad" : ""} aria-pressed=${one.name === photo.patch} title=${problem || words(one.name)}
        @click=${() => tell.select(one.name)}>${words(one.name)}${one.corners ? "" : ", curved"}${problem ? " ⚠" : ""}</button></li>`;
    })}</ul>
    ${patch
      ? html`
          ${choice("Points to drag", { plane: "Corners", curve: "Control points" }, isCurved ? "curve" : "plane", (one) => tell.points(one === "curve"))}
          <p class="hint">Drag the points. Or choose one with [ and ], and move it with the arrow keys.</p>
          ${handle?.kind === "control" ? weight(patch, handle.row, handle.column, tell) : nothing}
          <div class="field"><span>Real size</span><span class="pair">
            ${[1, 0].map((axis) => html`<input type="number" min="0" step="any" placeholder="auto" aria-label=${axis ? "Real width" : "Real height"}
              .value=${patch.size ? String(sides(patch.size)[axis]) : ""} @change=${(event: Event) => tell.change(resized(patch, axis, event))} />`)}</span></div>
          <p class="hint">Width and height in any unit, the same for all patches; without them the perspective decides.</p>
          <button @click=${tell.remove}>Remove ${words(patch.name).toLowerCase()}</button>
        `
      : nothing}
  `;
}

function weight(patch: PatchRecipe, row: number, column: number, tell: Tell): TemplateResult {
  const weight = surface(patch).weights[row][column];
  return slider("Weight", Math.round(100 * Math.log2(weight)), -300, 300, weight.toFixed(2), (value) =>
    tell.change((one) => weighted(one, row, column, 2 ** (value / 100))),
  );
}

function resized(patch: PatchRecipe, axis: number, event: Event): Change {
  const value = Number((event.target as HTMLInputElement).value);
  const size = sides(patch.size ?? "1");
  size[axis] = value;
  return ({ size: _, ...others }) => (value > 0 ? { ...others, size: sizeText(size) } : others);
}
