// The preview of a recipe, or the sheet of what several seeds make of it.
import type { PreviewPicture, Recipe, ToPage } from "./messages";
import type { Drawable } from "./picture-view";
import { newSheet, type Sheet, withSeed } from "./seed-sheet";
import { bitmap, pictureAddress } from "./server";
import { canvasOf, type Payload, type Studio } from "./studio";

const EXEMPLAR = 1024; // px of the exemplar that is shown, at most

export class MakePreviews {
  exemplar: ImageBitmap | null = null;
  private shown = ""; // the id of the exemplar that is wanted
  picture: Drawable | null = null;
  /** of `picture` relative to the result */
  scale = 1;
  done = 1;
  /** whether a finer picture follows */
  isRefined = false;
  problem = "";
  sheet: Sheet | null = null;
  private number = 0;
  private recipe: Recipe | null = null;

  /** ``largest``: px of the screen that there are for it */
  constructor(private readonly studio: Studio, private readonly largest: () => number, private readonly changed: () => void) {}

  /** Forget all but the last picture, which is shown until there is a better one; of another method also that. */
  forget(flow: string | undefined): void {
    if (flow !== this.recipe?.flow) this.picture = null;
    [this.problem, this.sheet] = ["", null];
  }

  /** Want none. */
  stop(): void {
    this.hold();
    this.picture = null;
  }

  /** Keep what there is: the processors are wanted for something else. */
  hold(): void {
    if (this.done < 1 || this.isRefined) this.studio.stopPreview();
    [this.done, this.isRefined, this.number] = [1, false, 0];
  }

  /** Show the picture that a recipe begins with. */
  async showExemplar(id: string): Promise<void> {
    if (id !== this.shown) this.exemplar = null;
    this.shown = id;
    const loaded = id && !this.exemplar && (await this.studio.attempt(bitmap(pictureAddress(id, EXEMPLAR))));
    if (!loaded || id !== this.shown) return;
    this.exemplar = loaded;
    this.changed();
  }

  ask(recipe: Recipe): void {
    [this.recipe, this.done, this.isRefined] = [recipe, 0, false];
    this.number = this.studio.preview(recipe, this.sheet ? 0 : this.largest());
    this.changed();
  }

  /** Ask for what seeds make, from that of the recipe on. */
  askForSheet(recipe: Recipe): void {
    this.sheet = newSheet(recipe.seed ?? 7);
    this.ask(recipe);
  }

  again(): void {
    [this.problem, this.done] = ["", 0];
    this.studio.repeat(this.number);
    this.changed();
  }

  receive(message: ToPage, payload: Payload): void {
    if (message.kind === "preview_picture" && message.number === this.number) this.onPicture(message, payload);
    else if (message.kind === "preview_failed" && message.number === this.number) {
      [this.problem, this.done, this.isRefined, this.picture] = [message.problem, 1, false, null];
      this.changed();
    }
  }

  private onPicture(message: PreviewPicture, payload: Payload): void {
    const picture = canvasOf(payload, message.width, message.height);
    [this.done, this.isRefined] = [message.done, message.done === 1 && !message.is_final];
    this.scale = message.scale;
    if (!this.sheet) this.picture = picture;
    else {
      const { waiting, first } = this.sheet;
      this.sheet = withSeed(this.sheet, picture, message.is_final);
      if (this.sheet.waiting > waiting) this.ask({ ...this.recipe!, seed: first + this.sheet.waiting });
    }
    this.changed();
  }
}
