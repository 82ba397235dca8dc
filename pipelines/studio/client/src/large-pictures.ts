// Pictures to look at: whole, or of large ones a small version and the tiles of the rest.
import type { ExrContents, Job, Picture } from "./messages";
import { bitmap, fileAddress, layers, pictureAddress } from "./server";
import { sides } from "./sizes";
import type { Tiles } from "./tiles";

export interface Viewed {
  picture: ImageBitmap;
  /** of a large one */
  tiles: Tiles | null;
}

const LARGE = 2048; // px of a side above which the server keeps a picture in tiles
const LARGE_RESULT = 4096; // px likewise of a result, of which smaller ones are there at once
const OVERVIEW = 1024; // px of a side of the small version

/** A picture of the library; ``known``: what the page knows of it; ``overview``: px of the small version. */
export async function viewed(id: string, known?: Picture, overview = OVERVIEW): Promise<Viewed> {
  const isLarge = known && Math.max(known.height, known.width) > LARGE && !known.is_material && !id.toLowerCase().endsWith(".exr");
  return isLarge ? inTiles(id, id, overview) : { picture: await bitmap(pictureAddress(id, LARGE)), tiles: null };
}

/** An exported picture of a run that is done. */
export async function viewedFile(job: Job, file: string): Promise<Viewed> {
  const [id, item] = [exportId(job, file), `job:${job.id}:${file}`];
  const isLarge = job.recipe.size || !id ? isLargeResult(job) : Math.max(...sizeOf(await layers(item))) >= LARGE_RESULT;
  return isLarge ? inTiles(id, item, OVERVIEW) : { picture: await bitmap(fileAddress(job.id, file)), tiles: null };
}

/** Where a map of a result is, as large as a lit material needs it. */
export const mapAddress = (job: Job, file: string): string =>
  isLargeResult(job) ? pictureAddress(exportId(job, file), LARGE) : fileAddress(job.id, file);

/** An export of a run as a picture of the library; empty where it has made none. */
const exportId = ({ texture }: Job, file: string): string => texture && texture.replace(/[^/]*$/, file);

const isLargeResult = ({ recipe, texture }: Job): boolean => Boolean(texture && recipe.size) && Math.max(...sides(recipe.size!)) >= LARGE_RESULT;

const sizeOf = ({ layers: [{ height, width }] }: ExrContents): [number, number] => [height, width];

async function inTiles(id: string, item: string, overview: number): Promise<Viewed> {
  const [picture, contents] = await Promise.all([bitmap(pictureAddress(id, overview)), layers(item)]);
  const [height, width] = sizeOf(contents);
  return { picture, tiles: { key: contents.key, layer: 0, height, width } };
}
