// The tiles of a picture of any size, of which only those in view are loaded.
import { endlessTile, RequestError, tile } from "./server";

/** Where the tiles of a picture are. */
export interface Tiles {
  key: string;
  layer: number;
  width: number;
  height: number;
  /** the run whose texture goes on without end; there is no layer then */
  endless?: string;
}
interface Place {
  level: number;
  row: number;
  column: number;
}

const SIDE = 512; // px of a tile
/** px of a side of what is shown of an endless texture, in whose middle its own window begins */
export const ENDLESS = 2 ** 20;
/** that there are; coarser tiles would take too long */
export const ENDLESS_LEVELS = 2;
const MOST_TILES = 192; // kept
const MOST_REQUESTS = 3; // at once, so that what has left the view is not loaded any more

/** Where a picture is drawn, and how much of it: its first pixel, screen pixels of a pixel, and the view's size. */
export interface Drawn {
  left: number;
  top: number;
  scale: number;
  width: number;
  height: number;
  isRepeated: boolean;
}

export class TileLayer {
  private isLoading = false;
  private isOver = false;
  private readonly loaded = new Map<string, ImageBitmap>();
  private readonly requested = new Set<string>();
  private wanted: Place[] = [];

  /** ``hasOverview``: whether something coarser is drawn below; ``tell``: `loading` with whether tiles are missing, or `problem` */
  constructor(
    readonly tiles: Tiles, private readonly hasOverview: boolean, private readonly changed: () => void,
    private readonly tell: (name: "loading" | "problem", detail: boolean | string) => void,
  ) {}

  /** Load no more, and forget all. */
  end(): void {
    [this.isOver, this.wanted] = [true, []];
    this.loaded.forEach((picture) => picture.close());
    this.loaded.clear();
    if (this.isLoading) this.tell("loading", false);
  }

  private get levels(): number {
    const { width, height, endless } = this.tiles;
    return endless ? ENDLESS_LEVELS : Math.max(0, Math.ceil(Math.log2(Math.max(width, height) / SIDE)));
  }

  /** Draw what is there of a picture, and load what is missing in view. */
  draw(context: CanvasRenderingContext2D, drawn: Drawn): void {
    const { left, top, scale, width, height, isRepeated } = drawn;
    const level = Math.min(this.levels, Math.max(0, Math.floor(Math.log2(1 / (scale * devicePixelRatio)) + 0.01)));
    const [across, down] = [this.tiles.width * scale, this.tiles.height * scale];
    const wanted = new Map<string, Place>();
    for (let y = isRepeated ? top - Math.ceil(top / down) * down : top; y < height; y += down) {
      for (let x = isRepeated ? left - Math.ceil(left / across) * across : left; x < width; x += across) {
        this.drawCopy(context, { ...drawn, left: x, top: y }, level, wanted);
        if (!isRepeated) break;
      }
      if (!isRepeated) break;
    }
    this.want([...wanted.values()]);
  }

  /** Draw the picture with its first pixel at a place of the screen. */
  private drawCopy(
    context: CanvasRenderingContext2D, { left, top, scale, width, height }: Drawn, level: number, wanted: Map<string, Place>,
  ): void {
    const { tiles } = this;
    const side = SIDE * 2 ** level;
    const range = (from: number, size: number, all: number): [number, number] => [
      Math.max(0, Math.floor(-from / (side * scale))), Math.min(Math.ceil(all / side), Math.ceil((size - from) / (side * scale))),
    ];
    const [firstRow, lastRow] = range(top, height, tiles.height);
    const [firstColumn, lastColumn] = range(left, width, tiles.width);
    const sharp = (value: number) => Math.round(value * devicePixelRatio) / devicePixelRatio; // no gaps between tiles
    for (let row = firstRow; row < lastRow; row += 1) {
      for (let column = firstColumn; column < lastColumn; column += 1) {
        const [x, y] = [column * side, row * side];
        const [w, h] = [Math.min(side, tiles.width - x), Math.min(side, tiles.height - y)];
        const found = this.nearest({ level, row, column });
        if (found?.level !== level) wanted.set(name({ level, row, column }), { level, row, column });
        if (!found) continue;
        const part = 2 ** found.level;
        const [originX, originY] = [found.column * SIDE, found.row * SIDE];
        const [begin, end] = [[left + x * scale, top + y * scale].map(sharp), [left + (x + w) * scale, top + (y + h) * scale].map(sharp)];
        context.drawImage(
          found.picture, x / part - originX, y / part - originY, w / part, h / part,
          begin[0], begin[1], end[0] - begin[0], end[1] - begin[1],
        );
      }
    }
  }

  /** The tile, or the finest of those that cover it and are there. */
  private nearest({ level, row, column }: Place): (Place & { picture: ImageBitmap }) | null {
    for (let up = 0; level + up <= this.levels; up += 1) {
      const place = { level: level + up, row: row >> up, column: column >> up };
      const picture = this.loaded.get(name(place));
      if (picture) return { ...place, picture };
    }
    return null;
  }

  // -- loading

  private want(places: Place[]): void {
    const overview = { level: this.levels, row: 0, column: 0 };
    const isCovered = this.hasOverview || this.tiles.endless || this.loaded.has(name(overview));
    this.wanted = isCovered || places.some((one) => one.level === overview.level) ? places : [...places, overview];
    this.load();
  }

  private load(): void {
    const most = this.tiles.endless ? 1 : MOST_REQUESTS; // the server makes one window at a time
    while (this.requested.size < most) {
      const next = this.wanted.find((one) => !this.requested.has(name(one)) && !this.loaded.has(name(one)));
      if (!next) break;
      void this.fetch(next);
    }
    if (this.isLoading !== this.requested.size > 0) {
      this.isLoading = this.requested.size > 0;
      this.tell("loading", this.isLoading);
    }
  }

  private async fetch(place: Place): Promise<void> {
    this.requested.add(name(place));
    let picture: ImageBitmap | null = null;
    try {
      picture = await loaded(this.tiles, place);
    } catch (error) {
      this.wanted = []; // until the view moves: what has failed may fail again
      if (!this.isOver) this.tell("problem", error instanceof RequestError ? error.message : String(error));
    }
    this.requested.delete(name(place));
    if (this.isOver) {
      picture?.close();
      return;
    }
    if (picture) {
      this.keep(name(place), picture);
      this.changed();
    } else {
      this.load();
    }
  }

  private keep(name: string, picture: ImageBitmap): void {
    this.loaded.set(name, picture);
    for (const [oldest, bitmap] of this.loaded) {
      if (this.loaded.size <= MOST_TILES) break;
      bitmap.close();
      this.loaded.delete(oldest);
    }
  }
}

function loaded(tiles: Tiles, { level, row, column }: Place): Promise<ImageBitmap> {
  if (!tiles.endless) return tile(tiles.key, tiles.layer, level, row, column);
  const first = ENDLESS / 2 / (SIDE * 2 ** level);
  return endlessTile(tiles.endless, level, row - first, column - first);
}

const name = ({ level, row, column }: Place): string => `${level}/${row}/${column}`;
