// What all views share: the socket, the runs, the pictures, and messages for the user.
import type { Draft } from "./drafts";
import type { Job, Picture, PreviewPicture, ProjectState, Recipe, Start, ToPage, ToServer, Variant } from "./messages";
import { Project } from "./project";
import { describe, type Purpose, RequestError, run, uploadMesh } from "./server";
import { Socket } from "./socket";

export type Payload = Uint8ClampedArray<ArrayBuffer>;
type Receiver = (message: ToPage, payload: Payload) => void;

const LARGE_FILE = 2 ** 20; // bytes of a picture that is shown while it is sent
const INCOMING = 1024; // px of its width

/**
 * Changes are told as events: `change`, `opened` where another material is to be shown, `problem` with a text,
 * `described` with a recipe that is to be shown, and `renewed` where the server knows nothing of this page any more.
 */
export class Studio extends EventTarget {
  readonly jobs = new Map<string, Job>();
  pictures: Picture[];
  /** those that were dropped since the page was opened, the last one first */
  added: Picture[] = [];
  /** ids of those of the folder and those that ship, after those that were dropped */
  meshes: readonly string[];
  /** the one that was dropped last */
  mesh = "";
  isConnected = false;
  /** a picture that is being sent, small, until the server shows it */
  incoming: ImageBitmap | null = null;
  private expected: File | null = null;
  private readonly receivers = new Set<Receiver>();
  private readonly socket: Socket;
  private number = 0;

  readonly project: Project;

  constructor(readonly begin: Start, project: ProjectState) {
    super();
    this.project = new Project(project, this);
    this.pictures = [...begin.listed.pictures];
    this.meshes = begin.meshes;
    this.socket = new Socket(
      (message, payload) => this.receive(message, payload),
      (is) => {
        this.isConnected = is;
        this.changed();
      },
      () => this.dispatchEvent(new Event("renewed")),
      (problem) => this.dispatchEvent(new CustomEvent("problem", { detail: problem })),
    );
  }

  /** Receive every message of the socket, until the returned function is called. */
  listen(receiver: Receiver): () => void {
    this.receivers.add(receiver);
    return () => this.receivers.delete(receiver);
  }

  send(message: ToServer, payload?: Uint8Array): void {
    this.socket.send(message, payload);
  }

  /** Ask once more for what was asked for under a number. */
  repeat(number: number): void {
    this.socket.repeat(number);
  }

  /** A number that tells the answers to one request from those to others. */
  next(): number {
    this.number += 1;
    return this.number;
  }

  /** Start a run; it is among `jobs` before the server tells of it. */
  async start(recipe: Recipe | undefined, purpose?: Purpose): Promise<Job | undefined> {
    const job = recipe && (await this.attempt(run(recipe, purpose)));
    if (job && !this.jobs.has(job.id)) this.jobs.set(job.id, job);
    return job;
  }

  /** Start a run whose result is one of the material that is open, maybe as a correction of another one. */
  async make(recipe: Recipe, parent = ""): Promise<Job | undefined> {
    const job = await this.start(recipe, { material: await this.project.ready(), parent });
    if (job) this.project.add({ job, made: Date.now() / 1000, parent, folder: "", starts: 0 });
    return job;
  }

  /** Show a recipe as a flow file and as a command. */
  async show(recipe: Recipe | undefined): Promise<void> {
    const described = recipe && (await this.attempt(describe(recipe)));
    if (described) this.dispatchEvent(new CustomEvent("described", { detail: described }));
  }

  /** Ask for a preview; its number tells its answers from those of others. It gets finer up to ``largest`` px. */
  preview(recipe: Recipe, largest: number): number {
    const number = this.next();
    this.send({ kind: "preview", number, recipe, largest });
    return number;
  }

  /** Let previews get no finer, as something else is to be computed. */
  stopPreview(): void {
    this.send({ kind: "preview_stop" });
  }

  /** Ask for a preview of what the server does not have yet, with a number of `next`. */
  async previewDraft({ recipe, attached }: Draft, number: number, largest: number): Promise<void> {
    const payload = new Uint8Array(await new Blob(Object.values(attached)).arrayBuffer());
    const attachedSizes = Object.fromEntries(Object.entries(attached).map(([name, { size }]) => [name, size]));
    this.send({ kind: "preview", number, recipe, attached: attachedSizes, largest }, payload);
  }

  /** Ask for other versions of a region; numbered as previews. */
  alternatives(recipe: Recipe, seeds: number[]): number {
    const number = this.next();
    this.send({ kind: "alternatives", number, recipe, seeds });
    return number;
  }

  picture(id: string): Picture | undefined {
    return [...this.pictures, ...this.begin.examples].find((one) => one.id === id);
  }

  add(picture: Picture): void {
    this.added = [picture, ...this.added.filter((one) => one.id !== picture.id)];
    this.pictures = [picture, ...this.pictures.filter((one) => one.id !== picture.id)];
    this.changed();
  }

  /** Show a file of a picture while the server reads it, if the browser can; none: show none any more. */
  async expect(file: File | null): Promise<void> {
    if (file === this.expected) return;
    [this.expected, this.incoming] = [file, null];
    this.changed();
    if (!file || file.size < LARGE_FILE) return;
    const picture = await createImageBitmap(file, { resizeWidth: INCOMING, resizeQuality: "medium" }).catch(() => null);
    if (this.expected === file) this.incoming = picture;
    this.changed();
  }

  /** Take a mesh into the library; its id. */
  async takeMesh(file: File): Promise<string | undefined> {
    const mesh = await this.attempt(uploadMesh(file));
    if (mesh) [this.mesh, this.meshes] = [mesh, [mesh, ...this.meshes.filter((one) => one !== mesh)]];
    this.changed();
    return mesh;
  }

  /** Know pictures that are not among those first listed. */
  know(pictures: Picture[]): void {
    const others = pictures.filter((one) => !this.picture(one.id));
    if (others.length) this.pictures = [...this.pictures, ...others];
  }

  /** Know runs of an earlier server. */
  knowRuns(variants: Variant[]): void {
    for (const { job } of variants) {
      const known = this.jobs.get(job.id);
      if (!known || isOver(job) || !isOver(known)) this.jobs.set(job.id, job); // else the socket was faster
    }
  }

  changed(): void {
    this.dispatchEvent(new Event("change"));
  }

  problem(error: unknown): void {
    const text = error instanceof RequestError ? error.message : `Something went wrong in the page: ${error}`;
    this.dispatchEvent(new CustomEvent("problem", { detail: text }));
  }

  /** Wait for something, and tell the user if it fails. */
  async attempt<T>(promise: Promise<T>): Promise<T | undefined> {
    try {
      return await promise;
    } catch (error) {
      this.problem(error);
      return undefined;
    }
  }

  private receive(message: ToPage, payload: Payload): void {
    if (message.kind === "job_changed") {
      this.jobs.set(message.job.id, message.job);
      this.changed();
    }
    this.project.receive(message);
    this.receivers.forEach((receiver) => receiver(message, payload));
  }
}

export const isOver = ({ state }: Job): boolean => state !== "waiting" && state !== "running";

/** Whether a finer preview follows one that is whole. */
export const isFollowed = ({ done, is_final }: PreviewPicture): boolean => done === 1 && !is_final;

/** Pixels of a message as something to draw. */
export function canvasOf(payload: Payload, width: number, height: number): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  canvas.getContext("2d")!.putImageData(new ImageData(payload, width, height), 0, 0);
  return canvas;
}

/** Text to the clipboard, also where the browser has none for pages without https. */
export async function copy(text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = document.body.appendChild(document.createElement("textarea"));
    area.value = text;
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

/** Let the browser save a text as a file. */
export function save(text: string, name: string): void {
  const address = URL.createObjectURL(new Blob([text]));
  download(address, name);
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

/** Let the browser save what is at an address. */
export function download(address: string, name: string): void {
  const link = document.createElement("a");
  [link.href, link.download] = [address, name];
  link.click();
}
