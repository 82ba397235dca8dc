// A photograph that is open on the layer Surfaces.
import type { Viewed } from "./large-pictures";
import type { PhotoPatch, PhotoRecipe, Picture } from "./messages";
import { AREA_COLORS, type Shown } from "./photo-canvas";
import type { PhotoDocument } from "./photo-document";
import { canvasOf, type Payload } from "./studio";
import { Undo } from "./undo";

/** A photograph with what has been done to it. */
export class Photo {
  readonly undo: Undo<PhotoDocument>;
  described: ReadonlyMap<string, PhotoPatch> = new Map();
  streamlines: Shown | null = null;
  front: HTMLCanvasElement | null = null;
  patch = "";

  constructor(
    readonly picture: Picture,
    readonly viewed: Viewed,
    begun: PhotoDocument,
    /** as they are in the session of the server, which only tells those that change */
    readonly areas = new Map<string, HTMLCanvasElement>(),
  ) {
    this.undo = new Undo(begun);
    this.patch = begun.patches[0]?.name ?? "";
  }

  get recipe(): PhotoRecipe {
    return { photo: this.picture.id, ...this.undo.now };
  }
}

/** what has been done to each since the page was loaded; one may be placed into another */
export const photos = new Map<string, Photo>();

/** An area in its colour. */
export function tinted(name: string, codes: Payload, width: number, height: number): HTMLCanvasElement {
  const pixels = new Uint8ClampedArray(4 * codes.length);
  const color = AREA_COLORS[name.split(".")[0]];
  codes.forEach((code, index) => pixels.set([...color, 0.45 * code], 4 * index));
  return canvasOf(pixels, width, height);
}
