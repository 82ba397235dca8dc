// Where in the exemplar the pixel under the pointer comes from.
import { html, type TemplateResult } from "lit";
import { customElement, property, query } from "lit/decorators.js";
import { Element } from "./element";
import type { Point } from "./picture-view";

const WIDTH = 150; // px

@customElement("source-inset")
export class SourceInset extends Element {
  @property({ attribute: false }) exemplar!: ImageBitmap;
  /** row and column of the exemplar's pixel of each pixel in turn */
  @property({ attribute: false }) origins!: Uint16Array;
  /** height and width of the result, px */
  @property({ attribute: false }) size: [number, number] = [1, 1];
  @property({ attribute: false }) place: Point = { x: 0, y: 0 };
  /** pixels of the exemplar in one of the picture of it */
  @property({ type: Number }) scale = 1;
  @query("canvas") private canvas!: HTMLCanvasElement;

  private get origin(): [number, number] | null {
    const [height, width] = this.size;
    const { x, y } = this.place;
    if (x < 0 || y < 0 || x >= width || y >= height) return null;
    const index = 2 * (y * width + x);
    return [this.origins[index], this.origins[index + 1]];
  }

  override render(): TemplateResult {
    const origin = this.origin;
    this.hidden = origin === null;
    return html`<canvas></canvas>${origin ? `From row ${origin[0]}, column ${origin[1]}` : ""}`;
  }

  protected override updated(): void {
    const { canvas, exemplar, origin } = this;
    if (!origin) return;
    const ratio = (WIDTH * devicePixelRatio) / exemplar.width;
    canvas.width = WIDTH * devicePixelRatio;
    canvas.height = exemplar.height * ratio;
    const context = canvas.getContext("2d")!;
    context.drawImage(exemplar, 0, 0, canvas.width, canvas.height);
    const [y, x] = origin.map((at) => (at / this.scale) * ratio);
    for (const [style, width] of [["rgb(0 0 0 / 0.6)", 4], ["#fff", 1.6]] as const) {
      context.strokeStyle = style;
      context.lineWidth = width * devicePixelRatio;
      context.beginPath();
      context.arc(x, y, 6 * devicePixelRatio, 0, 2 * Math.PI);
      context.stroke();
    }
  }
}
