// What the server says of a photograph: what follows from its patches and areas. One question is asked at a time, the newest next.
import type { PhotoPatch, PhotoProposal, ToPage } from "./messages";
import { type Photo, tinted } from "./photo";
import { EMPTY, type PhotoDocument } from "./photo-document";
import { canvasOf, type Payload, type Studio } from "./studio";

const FRONT = 320; // px of the patch as seen from the front

/** Who asks. */
interface Asker {
  readonly shown: Photo | null;
  readonly document: PhotoDocument;
  /** whether lines along the surfaces are wanted now */
  readonly wantsLines: boolean;
  /** told of planes */
  propose(planes: PhotoProposal["planes"]): void;
  /** told when the server has said whether the patches are valid; ``isNew``: for the first time of this document */
  follow(isNew: boolean): void;
}

export class PhotoAnswers {
  problem = "";
  /** what to try again, where the server has failed */
  failed: (() => void) | null = null;
  isProposing = false;
  /** of which the server has said, or will say, whether it is valid */
  asked: PhotoDocument = EMPTY;
  private told: PhotoDocument = EMPTY;
  private number = -1;
  private isWaiting = false;
  private isDirty = false;

  constructor(private readonly studio: Studio, private readonly asker: Asker) {}

  /** Wait for nothing any more, as the connection is lost. */
  lose(): void {
    this.isWaiting = false;
  }

  /** Ask what follows from the document; while an answer is awaited, only the newest is asked afterwards. */
  ask(): void {
    const { shown } = this.asker;
    this.isDirty = true;
    if (this.isWaiting || !shown) return;
    [this.isDirty, this.isWaiting, this.asked] = [false, true, this.asker.document];
    this.number = this.studio.next();
    const recipe = { ...shown.recipe, ...this.asked };
    this.studio.send({ kind: "photo", number: this.number, recipe, patch: shown.patch, side: FRONT, streamlines: this.asker.wantsLines });
  }

  /** Ask for planes. */
  propose(): void {
    const { shown } = this.asker;
    if (!shown) return;
    [this.isProposing, this.isWaiting] = [true, true];
    this.number = this.studio.next();
    this.studio.send({ kind: "photo", number: this.number, recipe: { photo: shown.picture.id }, propose: true });
  }

  /** Say that there is something that the server cannot help with. */
  refuse(problem: string): void {
    [this.failed, this.problem] = [null, problem];
  }

  receive(message: ToPage, payload: Payload): void {
    const photo = this.asker.shown;
    if (!photo || !("number" in message) || message.number !== this.number) return;
    if (message.kind === "photo_state") {
      this.problem = "";
      describe(photo, message.patches);
      const isNew = this.told !== this.asked;
      this.told = this.asked;
      this.asker.follow(isNew);
      this.answered();
    } else if (message.kind === "photo_proposal") {
      [this.isProposing, this.isWaiting] = [false, false];
      this.asker.propose(message.planes);
    } else if (message.kind === "photo_preview") {
      photo.front = canvasOf(payload, message.width, message.height);
    } else if (message.kind === "photo_area") {
      if (message.height) photo.areas.set(message.name, tinted(message.name, payload, message.width, message.height));
      else photo.areas.delete(message.name);
    } else if (message.kind === "photo_lines") {
      const plain = new Float32Array(payload.slice().buffer);
      photo.streamlines = { plain, lines: message.lines, points: message.points };
    } else if (message.kind === "preview_failed") {
      const proposed = this.isProposing;
      this.failed = () => (proposed ? this.propose() : this.ask());
      [this.problem, this.isProposing] = [message.problem, false];
      this.answered();
    }
  }

  private answered(): void {
    this.isWaiting = false;
    if (this.isDirty) this.ask();
  }
}

/** While a patch is invalid, the grids of before stay. */
function describe(photo: Photo, patches: PhotoPatch[]): void {
  const before = photo.described;
  photo.described = new Map(
    patches.map((one) => {
      const old = before.get(one.name);
      return [one.name, one.rows.length || !old ? one : { ...old, problem: one.problem }];
    }),
  );
  if (patches.some((one) => one.problem)) photo.streamlines = null;
}
