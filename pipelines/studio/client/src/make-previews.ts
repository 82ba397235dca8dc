// The preview of a recipe, or the sheet of its variants.
import type { PreviewPicture, Recipe, ToPage } from "./messages";
import type { Drawable } from "./picture-view";
import { viewed } from "./large-pictures";
import { bitmap, pictureAddress } from "./server";
import type { Tiles } from "./tiles";
import { canvasOf, isFollowed, type Payload, type Studio } from "./studio";
import { type Cell, type Sheet, withCell } from "./variants";

const RESULT = 2048; // px of a result in the sheet, at most

export class MakePreviews {
  exemplar: ImageBitmap | null = null;
  exemplarTiles: Tiles | null = null;
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
    if (id !== this.shown) [this.exemplar, this.exemplarTiles, this.picture] = [null, null, null];
    this.shown = id;
    const loaded = id && !this.exemplar && (await this.studio.attempt(viewed(id, this.studio.picture(id))));
    if (id !== this.shown) return;
    void this.studio.expect(null);
    if (!loaded) return;
    [this.exemplar, this.exemplarTiles] = [loaded.picture, loaded.tiles];
    this.changed();
  }

  ask(recipe: Recipe): void {
    [this.recipe, this.done, this.isRefined] = [recipe, 0, false];
    this.number = this.studio.preview(recipe, this.sheet ? 0 : this.largest());
    this.changed();
  }

  /** Fill a sheet, a cell after the other. */
  askForSheet(sheet: Sheet): void {
    this.hold();
    this.sheet = sheet;
    void this.goOn();
  }

  /** Make the next cell, if there is one. */
  private async goOn(): Promise<void> {
    const { sheet } = this;
    const next = sheet?.cells[sheet.waiting];
    this.changed();
    if (!next?.result) {
      if (next) this.ask(next.recipe);
      return;
    }
    const loaded = await this.studio.attempt(bitmap(pictureAddress(next.result.job.texture, RESULT)));
    if (this.sheet === sheet) this.fill(loaded ? { picture: loaded } : { problem: "It is no longer there." }, true);
  }

  private fill(change: Partial<Cell>, isFinal: boolean): void {
    this.sheet = withCell(this.sheet!, change, isFinal);
    if (isFinal) void this.goOn();
  }

  again(): void {
    [this.problem, this.done] = ["", 0];
    this.studio.repeat(this.number);
    this.changed();
  }

  receive(message: ToPage, payload: Payload): void {
    if (message.kind === "preview_picture" && message.number === this.number) this.onPicture(message, payload);
    else if (message.kind === "preview_failed" && message.number === this.number) {
      [this.done, this.isRefined] = [1, false];
      if (this.sheet) this.fill({ problem: message.problem }, true);
      else [this.problem, this.picture] = [message.problem, null];
      this.changed();
    }
  }

  private onPicture(message: PreviewPicture, payload: Payload): void {
    const picture = canvasOf(payload, message.width, message.height);
    [this.done, this.isRefined] = [message.done, isFollowed(message)];
    this.scale = message.scale;
    if (this.sheet) this.fill({ picture }, message.is_final);
    else this.picture = picture;
    this.changed();
  }
}
