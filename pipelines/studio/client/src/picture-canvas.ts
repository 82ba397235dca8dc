// How a picture is drawn: fitted, repeated without end, or beside the exemplar, with tiles where it is large.
import { property, query } from "lit/decorators.js";
import { Element } from "./element";
import { TileLayer, type Tiles } from "./tiles";

export interface Point {
  x: number;
  y: number;
}
export interface Patch {
  picture: Drawable;
  x: number;
  y: number;
}
/** What a hand or the keys do in a picture, at a place in its pixels, of which each is 1 wide. */
export interface Act extends Point {
  phase: "hover" | "begin" | "drag" | "end" | "cancel" | "leave";
  /** screen pixels of a pixel */
  scale: number;
  /** the right button, or the eraser of a pen */
  isOther: boolean;
  isDouble: boolean;
}
/** Draws over a picture; ``at`` gives the place in the view of one in the picture's pixels. */
export type Over = (context: CanvasRenderingContext2D, at: (point: Point) => [number, number], scale: number) => void;
/** What of a picture is in view: screen pixels that it is wide, 0 where it fits, and the middle in shares of it. */
export interface Look extends Point {
  span: number;
}
export const FITTED: Look = { span: 0, x: 0.5, y: 0.5 };
export type Mode = "single" | "repeat" | "compare";
export type Drawable = ImageBitmap | HTMLCanvasElement;

/** Tells `loading` with whether tiles are missing, and `problem` where one cannot be loaded. */
export abstract class PictureCanvas extends Element {
  @property({ attribute: false }) picture: Drawable | null = null;
  @property({ attribute: false }) exemplar: Drawable | null = null;
  /** how large the exemplar's pixels are, in pixels of the picture */
  @property({ type: Number }) exemplarScale = 1;
  /** whether it stands for a larger picture, whose pixels are not these */
  @property({ type: Boolean }) isReduced = false;
  @property() mode: Mode = "single";
  @property() label = "Texture";
  /** what dragging does: pan; draw around a spot, when `lasso` is told, with points of the picture; or what those make
   * of it that listen to `act` */
  @property() tool: "pan" | "lasso" | "act" = "pan";
  /** height and width that the picture is shown at, if not its own, px */
  @property({ attribute: false }) extent: [number, number] | null = null;
  @property({ attribute: false }) over: Over | null = null;
  /** a line around a spot, in pixels of the picture */
  @property({ attribute: false }) outline: Point[] = [];
  /** places that are numbered */
  @property({ attribute: false }) marks: Point[] = [];
  /** a part that is shown in place of what is there */
  @property({ attribute: false }) patch: Patch | null = null;
  /** what is in view, where that is the same of several pictures; each of them tells `look` when it is moved */
  @property({ attribute: false }) look: Look | null = null;
  /** what the picture is a small version of */
  @property({ attribute: false }) tiles: Tiles | null = null;
  /** what the exemplar is a small version of */
  @property({ attribute: false }) exemplarTiles: Tiles | null = null;
  @query("canvas") protected canvas!: HTMLCanvasElement;

  protected zoom = 0; // screen pixels of a pixel; 0 fits
  protected center = { x: 0.5, y: 0.5 }; // of the view, in shares of the picture
  protected split = 0.5;
  protected isDrawing = false;
  protected drawn: Point[] = []; // the line so far; `outline` is set again whenever something around this element changes
  private tileLayer: TileLayer | null = null;
  private exemplarLayer: TileLayer | null = null;
  private shownWidth = 0;
  private readonly observer = new ResizeObserver(() => this.draw());

  protected override firstUpdated(): void {
    this.observer.observe(this.canvas);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.observer.disconnect();
    this.tileLayer = this.layerOf(null, this.tileLayer, this.picture);
    this.exemplarLayer = this.layerOf(null, this.exemplarLayer, this.exemplar);
  }

  protected override updated(): void {
    const [before, now] = [this.shownWidth, this.size?.width ?? 0];
    if (!this.extent && before && now && this.zoom) this.zoom *= before / now;
    this.shownWidth = now;
    if (this.look && this.size) {
      const { span, x, y } = this.look;
      [this.zoom, this.center] = [span / this.size.width, { x, y }];
    }
    this.draw();
  }

  fit(): void {
    this.zoom = 0;
    this.center = { x: 0.5, y: 0.5 };
    this.moved();
  }

  /** Draw what is in view now, and tell those that show as much. */
  protected moved(): void {
    this.draw();
    if (this.look) this.tell<Look>("look", { span: this.zoom * (this.size?.width ?? 0), ...this.center });
  }

  /** Width and height that the picture is shown at. */
  protected get size(): { width: number; height: number } | null {
    return this.extent ? { width: this.extent[1], height: this.extent[0] } : this.tiles ?? this.picture;
  }

  /** Screen pixels of a pixel of the picture. */
  protected get scale(): number {
    const size = this.size;
    if (this.zoom || !size) return this.zoom || 1;
    const { clientWidth, clientHeight } = this.canvas;
    const parts = this.mode === "repeat" ? 2.5 : 1;
    const margin = this.mode === "repeat" || this.look ? 0 : 32;
    const fit = Math.min(
      (clientWidth - margin) / size.width,
      (clientHeight - margin) / size.height,
    );
    return Math.max(0.01, fit / parts);
  }

  /** The least `scale` that zooming reaches. */
  protected get smallest(): number {
    return 0.02;
  }

  /** The part of the picture that is in view, px. */
  get window(): { top: number; left: number; height: number; width: number } {
    const [height, width] = [this.canvas.clientHeight / this.scale, this.canvas.clientWidth / this.scale].map(Math.round);
    const { x, y } = this.center;
    return { top: Math.round(y * this.size!.height - height / 2), left: Math.round(x * this.size!.width - width / 2), height, width };
  }

  draw(): void {
    const { canvas } = this;
    if (!canvas) return;
    const ratio = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d")!;
    this.tileLayer = this.layerOf(this.tiles, this.tileLayer, this.picture);
    this.exemplarLayer = this.layerOf(this.exemplarTiles, this.exemplarLayer, this.exemplar);
    const size = this.size;
    if (!size) return;
    context.scale(ratio, ratio);
    const scale = this.scale;
    context.imageSmoothingQuality = "high";
    const left = width / 2 - this.center.x * size.width * scale;
    const top = height / 2 - this.center.y * size.height * scale;
    this.drawContent(context, left, top, scale, width, height);
    this.over?.(context, ({ x, y }) => [left + x * scale, top + y * scale], scale);
    if (this.mode === "single") this.drawMarks(context, left, top, scale);
    if (this.mode === "compare" && this.exemplar) this.drawExemplar(context, left, top, scale, width, height);
  }

  protected drawMarks(context: CanvasRenderingContext2D, left: number, top: number, scale: number): void {
    if (this.patch) {
      const { picture, x, y } = this.patch;
      context.drawImage(picture, left + x * scale, top + y * scale, picture.width * scale, picture.height * scale);
    }
    const at = ({ x, y }: Point): [number, number] => [left + (x + 0.5) * scale, top + (y + 0.5) * scale];
    const stroke = (path: Path2D) => {
      for (const [style, width] of [["rgb(0 0 0 / 0.6)", 4], ["#fff", 1.6]] as const) {
        context.strokeStyle = style;
        context.lineWidth = width;
        context.stroke(path);
      }
    };
    const line = this.isDrawing ? this.drawn : this.outline;
    if (line.length > 1) {
      const path = new Path2D();
      line.forEach((point, index) => (index ? path.lineTo(...at(point)) : path.moveTo(...at(point))));
      if (!this.isDrawing) path.closePath();
      stroke(path);
    }
    [context.font, context.textAlign, context.textBaseline] = ["600 10px system-ui", "center", "middle"];
    this.marks.forEach((mark, index) => {
      const path = new Path2D();
      path.arc(...at(mark), 9, 0, 2 * Math.PI);
      context.fillStyle = "rgb(0 0 0 / 0.45)";
      context.fill(path);
      stroke(path);
      context.fillStyle = "#fff";
      context.fillText(String(index + 1), ...at(mark));
    });
  }

  protected drawContent(
    context: CanvasRenderingContext2D, left: number, top: number, scale: number, width: number, height: number,
  ): void {
    const [picture, size] = [this.picture, this.size!];
    context.imageSmoothingEnabled = this.isReduced || scale < 3 || this.tiles !== null; // small until its tiles are there
    if (picture) this.drawPicture(context, picture, left, top, scale, width, height);
    context.imageSmoothingEnabled = this.isReduced || scale < 3;
    if (this.tileLayer && isCoarse(picture, size.width * scale)) {
      this.tileLayer.draw(context, { left, top, scale, width, height, isRepeated: this.mode === "repeat" });
    } else if (!picture) {
      context.fillStyle = getComputedStyle(this).getPropertyValue("--panel");
      context.fillRect(left, top, size.width * scale, size.height * scale);
    }
  }

  private drawPicture(
    context: CanvasRenderingContext2D, picture: Drawable, left: number, top: number, scale: number, width: number, height: number,
  ): void {
    const size = this.size!;
    if (this.mode !== "repeat") {
      context.drawImage(picture, left, top, size.width * scale, size.height * scale);
      return;
    }
    const pattern = context.createPattern(picture, "repeat")!;
    pattern.setTransform(new DOMMatrix([(scale * size.width) / picture.width, 0, 0, (scale * size.height) / picture.height, left, top]));
    context.fillStyle = pattern;
    context.fillRect(0, 0, width, height);
  }

  private drawExemplar(
    context: CanvasRenderingContext2D, left: number, top: number, scale: number, width: number, height: number,
  ): void {
    const exemplar = this.exemplar!;
    const edge = this.split * width;
    const size = scale * this.exemplarScale;
    context.save();
    context.beginPath();
    context.rect(0, 0, edge, height);
    context.clip();
    context.fillStyle = getComputedStyle(this).getPropertyValue("--canvas");
    context.fillRect(0, 0, edge, height);
    context.drawImage(exemplar, left, top, exemplar.width * size, exemplar.height * size);
    if (this.exemplarLayer && isCoarse(exemplar, exemplar.width * size)) {
      const scaled = (exemplar.width * size) / this.exemplarLayer.tiles.width;
      this.exemplarLayer.draw(context, { left, top, scale: scaled, width: edge, height, isRepeated: false });
    }
    context.restore();
    context.fillStyle = getComputedStyle(this).getPropertyValue("--accent");
    context.fillRect(edge - 1, 0, 2, height);
    context.beginPath();
    context.arc(edge, height / 2, 9, 0, 2 * Math.PI);
    context.fill();
  }

  /** The layer of some tiles, which is that of before or a new one. */
  private layerOf(tiles: Tiles | null, before: TileLayer | null, below: Drawable | null): TileLayer | null {
    if (tiles && before?.tiles === tiles) return before;
    before?.end();
    return tiles && new TileLayer(tiles, below !== null, () => this.draw(), (name, detail) => this.tell(name, detail));
  }
}

/** Whether a picture has fewer pixels than the screen shows of it. */
const isCoarse = (picture: Drawable | null, width: number): boolean => !picture || picture.width < width * devicePixelRatio;
