// What there is before any picture is chosen: the way from a photograph to a material, in one picture.
import { html, nothing, svg, type TemplateResult } from "lit";
import type { Picture } from "./messages";

const ROWS = [0, 1, 2, 3];
const brick = (x: number, y: number): TemplateResult => svg`<rect x=${x} y=${y} width="16" height="7" rx="1" />`;
const bricks = ROWS.map((row) => svg`${[-8, 10, 28, 46].map((x) => brick(x + (row % 2 ? 9 : 0), 4 + 10 * row))}`);
const arrow = (x: number): TemplateResult => svg`<path class="arrow" d="M${x} 32h16m-5 -5l5 5l-5 5" />`;
const told = (x: number, text: string): TemplateResult => svg`<text x=${x} y="80">${text}</text>`;

/** A wall at an angle, the same flat, on a sphere, and as the files of a program. */
const WAY = html`<svg viewBox="0 0 372 86" role="img" aria-label="A photograph becomes a flat picture, then a lit material, then files for a program">
  <defs>
    <clipPath id="flat"><rect width="52" height="44" rx="3" /></clipPath>
    <clipPath id="round"><circle cx="26" cy="22" r="22" /></clipPath>
  </defs>
  <g transform="translate(8 10)"><rect class="paper" width="64" height="44" rx="3" /><path class="sun" d="M50 10m-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0" />
    <g transform="matrix(.62 .16 0 .72 6 6)"><g clip-path="url(#flat)">${bricks}</g></g></g>
  ${arrow(82)}
  <g transform="translate(112 10)"><rect class="paper" width="52" height="44" rx="3" /><g clip-path="url(#flat)">${bricks}</g></g>
  ${arrow(174)}
  <g transform="translate(202 10)"><circle class="paper" cx="26" cy="22" r="22" /><g clip-path="url(#round)">${bricks}</g><circle class="shade" cx="34" cy="30" r="22" clip-path="url(#round)" /></g>
  ${arrow(266)}
  <g transform="translate(296 10)">${[0, 8, 16].map((by) => svg`<rect class="paper" x=${by} y=${by / 2} width="44" height="34" rx="3" />`)}</g>
  ${told(40, "photograph")} ${told(138, "flat")} ${told(228, "material")} ${told(326, "files")}
</svg>`;

/** The guide to a first material; ``example`` is one to try it with. */
export const welcome = (example: Picture | undefined, take: (picture: Picture) => void): TemplateResult => html`<div class="welcome first">
  ${WAY}
  <h2>Your first material</h2>
  <ol>
    <li><strong>Drop a photograph</strong> anywhere, a flat picture, or a folder of maps.</li>
    <li><strong>Colour only, or all maps?</strong> Those that are missing are estimated.</li>
    <li><strong>Size and tiling.</strong> The preview follows.</li>
    <li><strong>Finish</strong>, and correct spots that you do not like.</li>
    <li><strong>Export</strong> for Unreal, Blender, Unity, Godot and others.</li>
  </ol>
  ${example ? html`<p><button @click=${() => take(example)}>Try it with ${example.name}</button></p>` : nothing}
</div>`;
