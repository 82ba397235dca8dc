// The texture that follows a painted map, as the server keeps it: a draft, while it summarises the picture, and then the whole.
import { type Area, type ControlMap, joined } from "./control-map";
import type { PaintPicture, Picture, ToPage } from "./messages";
import { sizeText } from "./sizes";
import type { Payload, Studio } from "./studio";

const DRAFT = 128; // px of the shorter sides of picture and canvas for a draft, at least
const LARGEST_DRAFT = 192; // px of that of the picture, at most: larger ones take long

/** What is painted on. */
export interface Original {
  picture: Picture;
  /** id of the map that says what is where in it; empty: its brightness */
  control: string;
  seed: number;
}

export class PaintCanvas {
  state: "none" | "opening" | "draft" | "ready" = "none";
  /** how far the summary is */
  progress = "";
  problem = "";
  pixels: HTMLCanvasElement | null = null;
  /** id of the control map that is used */
  control = "";
  private original: Original | null = null;
  private number = -1;
  private summary = -1;
  private scale = 1; // of the canvas that is open or being opened
  private isNew = false; // whether no picture of it has come
  private dirty: Area | null = null;
  private isWaiting = false;

  constructor(private readonly studio: Studio, private readonly map: () => ControlMap, private readonly changed: () => void) {}

  /** Know nothing any more. */
  forget(): void {
    [this.state, this.progress, this.problem, this.pixels] = ["none", "", "", null];
    [this.number, this.summary, this.control] = [-1, -1, ""];
  }

  /** Have the server summarise a picture, and open a canvas of the map as soon as it can. */
  begin(original: Original): void {
    this.forget();
    [this.state, this.original] = ["opening", original];
    const { picture, control, seed } = original;
    const [least, side] = [Math.min(picture.height, picture.width), this.map().width];
    this.open(Math.min(1, LARGEST_DRAFT / least, Math.max(DRAFT / least, DRAFT / side)));
    if (this.scale === 1) return; // which summarises so little itself
    this.summary = this.studio.next();
    this.studio.send({ kind: "paint_summary", number: this.summary, texture: picture.id, control, seed });
  }

  /** Go on where the server has lost it. */
  renew(): void {
    if (this.original && this.state !== "none") this.begin(this.original);
  }

  private open(scale: number): void {
    const { picture, control, seed } = this.original!;
    [this.scale, this.isNew, this.isWaiting, this.dirty, this.number] = [scale, true, true, null, this.studio.next()];
    this.studio.send({
      kind: "paint_open", number: this.number, texture: picture.id, control, size: sizeText([this.side, this.side]), seed, scale,
    }, this.map().reduced(this.side));
  }

  /** Of the canvas that is open, px. */
  private get side(): number {
    return Math.max(16, Math.round(this.scale * this.map().width));
  }

  get canPaint(): boolean {
    return this.state === "draft" || this.state === "ready";
  }

  /** A part of the map has changed. */
  follow(area: Area): void {
    this.dirty = joined(this.dirty, area);
    this.flush();
  }

  /** Send what has been painted, unless the server still works on the strokes before. */
  private flush(): void {
    if (this.isWaiting || !this.dirty?.height || !this.canPaint) return;
    const { side } = this;
    const area = this.scale < 1 ? { top: 0, left: 0, height: side, width: side } : this.dirty;
    [this.dirty, this.isWaiting] = [null, true];
    const codes = this.scale < 1 ? this.map().reduced(side) : this.map().part(area);
    this.studio.send({ kind: "paint_dab", number: this.number, ...area }, codes);
  }

  /** Take what the server says; whether the whole canvas has been opened. */
  receive(message: ToPage, payload: Payload): boolean {
    if (!("number" in message) || ![this.number, this.summary].includes(message.number)) return false;
    const isWhole = this.scale === 1;
    if (message.kind === "paint_progress") {
      if (message.number === this.summary || isWhole) this.progress = `${message.step} ${message.done ? `${Math.round(100 * message.done)} %` : ""}`;
    } else if (message.kind === "paint_summarised") {
      this.open(1);
    } else if (message.kind === "paint_opened") {
      [this.state, this.control] = isWhole ? ["ready", message.control] : ["draft", ""];
      this.changed();
      return isWhole;
    } else if (message.kind === "paint_picture") {
      this.onPicture(message, payload);
    } else if (message.kind === "preview_failed" && (message.number === this.summary || isWhole)) { // else there is no draft
      [this.problem, this.isWaiting] = [message.problem, false];
      if (!this.pixels) this.state = "none";
    }
    this.changed();
    return false;
  }

  private onPicture({ height, width, top, left }: PaintPicture, payload: Payload): void {
    if (this.isNew) {
      this.pixels = document.createElement("canvas");
      [this.pixels.width, this.pixels.height, this.isNew] = [this.side, this.side, false];
    }
    if (height && width) this.pixels!.getContext("2d")!.putImageData(new ImageData(payload, width, height), left, top);
    this.isWaiting = false;
    this.flush();
  }
}
