// The results of a recipe at full size, and what is known of the one that is shown.
import type { BadPlace, Job, Recipe, ToPage, Variant } from "./messages";
import type { Drawable, Point } from "./picture-view";
import { recipeKey } from "./recipe-key";
import { viewedFile } from "./large-pictures";
import { insight } from "./server";
import { canvasOf, type Payload, type Studio } from "./studio";
import type { Tiles } from "./tiles";
import { Undo } from "./undo";

export const TEXTURE = "texture.png";

export class MadeResults {
  /** the runs whose results are shown: at full size, and after each correction */
  runs = new Undo<string>("");
  picture: Drawable | null = null;
  /** of a large one, of which `picture` is a small version */
  tiles: Tiles | null = null;
  /** whether `picture` is the finished one, not one of a scale */
  isWhole = false;
  /** the places least like the exemplar */
  places: BadPlace[] = [];
  /** where in the exemplar each pixel comes from */
  origins: Uint16Array | null = null;
  /** the runs of each recipe, by its key, so that nothing is lost when a setting is changed and changed back */
  private readonly made = new Map<string, Undo<string>>();
  private wanted = ""; // the export that was asked for last
  /** the worst places that corrections have left, by run */
  private readonly left = new Map<string, BadPlace[]>();

  constructor(private readonly studio: Studio, private readonly changed: () => void) {}

  get id(): string {
    return this.runs.now;
  }

  get job(): Job | undefined {
    return this.studio.jobs.get(this.id);
  }

  /** Height and width of the result that is shown, px. */
  get size(): [number, number] {
    const { height, width } = this.tiles ?? this.picture ?? { height: 1, width: 1 };
    return [height, width];
  }

  forget(): void {
    this.runs = new Undo<string>("");
    [this.picture, this.tiles, this.isWhole, this.places, this.origins] = [null, null, false, [], null];
  }

  /** Go back to the runs of a recipe, if there are any. */
  recall(recipe: Recipe | null): void {
    this.runs = this.made.get(recipeKey(recipe)) ?? this.runs;
  }

  /** Know the results of a material that is opened, of which one is looked at. */
  restore(variants: readonly Variant[], shown: string): void {
    this.forget();
    this.made.clear();
    this.left.clear();
    const last = variants.find(({ job }) => job.id === shown);
    for (const one of last ? [...variants, last] : variants) this.open(variants, one);
  }

  /** Go back to a result of a material; the recipe that it was made by, before any correction. */
  open(variants: readonly Variant[], variant: Variant): Recipe {
    const steps = [variant];
    for (let one: Variant | undefined = variant; one?.parent; ) {
      one = variants.find(({ job }) => job.id === one!.parent);
      if (!one || steps.includes(one)) break;
      steps.unshift(one);
    }
    const runs = new Undo(steps[0].job.id);
    steps.slice(1).forEach(({ job }) => runs.set(job.id));
    const { recipe } = steps[0].job;
    this.made.set(recipeKey(recipe), runs);
    return recipe;
  }

  begin(recipe: Recipe, job: Job): void {
    this.runs = new Undo(job.id);
    this.made.set(recipeKey(recipe), this.runs);
  }

  /** Go on with a correction, which has left some of the worst places. */
  correct(job: Job, outline: Point[]): void {
    this.left.set(job.id, outside(outline, this.places));
    this.runs.set(job.id);
  }

  /** Show an export of a run that is done. */
  async load(job: Job, file: string): Promise<void> {
    const wanted = job.files.includes(file) ? file : job.files.includes(TEXTURE) ? TEXTURE : "";
    this.wanted = wanted;
    const loaded = wanted && (await this.studio.attempt(viewedFile(job, wanted)));
    if (!loaded || job.id !== this.id || wanted !== this.wanted) return;
    [this.picture, this.tiles, this.isWhole] = [loaded.picture, loaded.tiles, true];
    [this.places, this.origins] = [this.left.get(job.id) ?? [], null];
    this.changed();
    if (wanted !== TEXTURE) return;
    const told = !this.left.has(job.id) && (await this.studio.attempt(insight(job.id)));
    if (!told || job.id !== this.id || this.picture !== loaded.picture) return;
    this.places = told[0].places;
    if (told[0].height === this.size[0] && told[1].length) this.origins = told[1];
    this.changed();
  }

  /** Take a picture of a scale. */
  receive(message: ToPage, payload: Payload): void {
    if (message.kind !== "job_picture" || message.job !== this.id || this.runs.canUndo) return;
    [this.picture, this.tiles, this.isWhole] = [canvasOf(payload, message.width, message.height), null, false];
    this.changed();
  }
}

/** The places that are not inside of an outline. */
function outside(outline: Point[], places: BadPlace[]): BadPlace[] {
  const path = new Path2D();
  outline.forEach(({ x, y }) => path.lineTo(x, y));
  const context = new OffscreenCanvas(1, 1).getContext("2d")!;
  return places.filter(({ row, column }) => !context.isPointInPath(path, column, row));
}
