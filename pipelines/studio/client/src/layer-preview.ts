// The preview of a layer that draws otherwise than on pictures beside each other: a small picture while a hand moves, finer ones afterwards.
import { type Draft } from "./drafts";
import type { ToPage } from "./messages";
import { canvasOf, isFollowed, type Payload, type Studio } from "./studio";

export class LayerPreview {
  picture: HTMLCanvasElement | null = null;
  /** whether it is of the full size, and so the result */
  isWhole = false;
  problem = "";
  private done = 1;
  private isRefined = false;
  private number = -1;
  private isWanted = false;
  private turn = 0;

  /** ``draft``: what is drawn, none where nothing can be made of it; ``largest``: px of the screen that there are */
  constructor(
    private readonly studio: Studio, private readonly draft: () => Promise<Draft | undefined>, private readonly largest: () => number,
    private readonly changed: () => void,
  ) {}

  /** Follow a hand that draws: small pictures alone, each when the one before is there. */
  follow(): void {
    if (this.done < 1) this.isWanted = true;
    else void this.send(0);
  }

  /** Show what is drawn now, and refine it. */
  ask(): void {
    this.isWanted = false;
    void this.send(this.largest());
  }

  /** Keep what there is: the processors are wanted for something else. */
  stop(): void {
    if (this.done < 1 || this.isRefined) this.studio.stopPreview();
    this.turn += 1;
    [this.problem, this.done, this.isRefined, this.isWanted, this.number] = ["", 1, false, false, -1];
  }

  private async send(largest: number): Promise<void> {
    this.turn += 1;
    const { turn } = this;
    [this.done, this.problem, this.isWhole, this.number] = [0, "", false, -1]; // pictures of what was drawn before come too late
    this.changed();
    const draft = await this.draft();
    if (turn !== this.turn) return;
    if (!draft) {
      this.stop();
      this.picture = null;
      this.changed();
      return;
    }
    this.number = this.studio.next();
    await this.studio.previewDraft(draft, this.number, largest);
  }

  receive(message: ToPage, payload: Payload): void {
    if (!("number" in message) || message.number !== this.number) return;
    if (message.kind === "preview_picture") {
      this.picture = canvasOf(payload, message.width, message.height);
      [this.done, this.isRefined, this.isWhole] = [message.done, isFollowed(message), message.scale === 1 && message.done === 1];
    } else if (message.kind === "preview_failed") [this.problem, this.done, this.isRefined] = [message.problem, 1, false];
    else return;
    if (this.done === 1 && this.isWanted) {
      this.isWanted = false;
      this.follow();
    }
    this.changed();
  }

  /** What a person is told of it; empty: there is none. */
  get status(): string {
    if (this.problem) return this.problem;
    if (this.done < 1) return this.picture ? "Following …" : "Preparing the first preview …";
    if (this.isRefined) return "Preview; a finer one is being made …";
    if (!this.picture) return "";
    return this.isWhole ? "Preview at full size" : "Preview; the full size has its own details";
  }
}
