// What the modes of the view Direct share: an exemplar, the size of the result, its preview, and runs at full size.
import { html, nothing, type TemplateResult } from "lit";
import { property, state } from "lit/decorators.js";
import { type Draft, kept } from "./drafts";
import { Element } from "./element";
import { failure, choice, isTyping, undoButtons } from "./fields";
import "./job-panel";
import type { Job, Method, Picture, Recipe, ToPage } from "./messages";
import type { Drawable, PictureView } from "./picture-view";
import "./picture-view";
import "./recipe-form";
import { bitmap, fileAddress, pictureAddress } from "./server";
import { screenPixels, sides, sizeText } from "./sizes";
import { canvasOf, isFollowed, type Payload, type Studio } from "./studio";

export const MODES = { paint: "Paint", collage: "Collage", lattice: "Lattice" } as const;
export type ModeName = keyof typeof MODES;
const EXEMPLAR = 2048; // px of the exemplar that is shown, at most
const LEAST = 512; // px of a result to begin with

/** Tells `mode` with another one, and `inspect` with a result. */
export abstract class DirectMode extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) picture!: Picture;
  @state() protected exemplar: ImageBitmap | null = null;
  /** the preview, or the result at full size */
  @state() protected shown: Drawable | null = null;
  @state() protected size: [number, number] = [512, 512];
  @state() private form: Partial<Recipe> = {};
  @state() private done = 1;
  /** whether a finer preview follows */
  @state() private isRefined = false;
  @state() private problem = "";
  /** what to try again, where the server has failed */
  protected failed: (() => void) | null = null;
  @state() private job = "";
  protected abstract readonly name: ModeName;
  protected readonly presets: string[] = ["default", "fast"];
  private number = -1;
  private turn = 0;
  private stop: (() => void) | null = null;

  /** What would be made now; a text says what is missing. */
  protected abstract draft(): Promise<Draft | string>;
  /** Begin with another exemplar. */
  protected abstract reset(): void;

  override connectedCallback(): void {
    super.connectedCallback();
    this.stop = this.studio.listen((message, payload) => this.receive(message, payload));
    this.studio.addEventListener("change", this.update_);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.stop?.();
    this.studio.removeEventListener("change", this.update_);
  }

  protected override willUpdate(changed: Map<string, unknown>): void {
    if (changed.has("picture")) void this.open();
  }

  private readonly update_ = (): void => this.requestUpdate();

  private async open(): Promise<void> {
    const { picture } = this;
    const side = Math.max(LEAST, 2 ** Math.round(Math.log2(Math.max(picture.height, picture.width))));
    [this.size, this.exemplar, this.shown, this.job, this.problem, this.done] = [[side, side], null, null, "", "", 1];
    this.number = -1;
    this.form = {};
    this.reset();
    const loaded = await this.studio.attempt(bitmap(pictureAddress(picture.id, EXEMPLAR)));
    if (loaded && picture === this.picture) this.exemplar = loaded;
    if (this.checkVisibility()) this.changed();
  }

  // -- keys

  protected override onWindowKey(event: KeyboardEvent): void {
    if (!this.offsetParent && !this.querySelector("section")?.offsetParent) return; // another view is shown
    if (isTyping(event) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.onKey(event.key)) event.preventDefault();
  }

  protected abstract stepBy(direction: "undo" | "redo"): void;

  /** Whether a key meant something. */
  protected onKey(_key: string): boolean {
    return false;
  }

  // -- previews and results

  /** Something has changed: show what that makes. */
  protected changed(): void {
    this.job = "";
    this.requestUpdate();
    void this.ask();
  }

  /** A refusal of the server in the words of this mode. */
  protected explained(problem: string): string {
    return problem;
  }

  /** Say why something is not done. */
  protected refuse(problem: string, again: (() => void) | null = null): void {
    [this.problem, this.failed] = [problem, again];
  }

  private async ask(): Promise<void> {
    this.turn += 1;
    const turn = this.turn;
    const draft = await this.draft();
    if (turn !== this.turn) return;
    if (typeof draft === "string") {
      this.refuse(draft);
      [this.done, this.number] = [1, -1];
      return;
    }
    this.refuse("");
    [this.done, this.isRefined] = [0, false];
    this.number = this.studio.next();
    await this.studio.previewDraft(draft, this.number, screenPixels(this.querySelector(".panes")));
  }

  protected base(flow: string, sources: Record<string, string> = {}, params: Recipe["params"] = {}): Recipe {
    return { ...this.form, flow, sources: { exemplar: this.picture.id, ...sources }, size: sizeText(this.size), params };
  }

  private receive(message: ToPage, payload: Payload): void {
    if (message.kind === "preview_picture" && message.number === this.number) {
      this.shown = canvasOf(payload, message.width, message.height);
      [this.done, this.isRefined] = [message.done, isFollowed(message)];
    } else if (message.kind === "preview_failed" && message.number === this.number) {
      this.refuse(this.explained(message.problem), () => void this.ask());
      this.done = 1;
    } else if (message.kind === "job_changed" && message.job.id === this.job && message.job.state === "done") {
      void this.load(message.job);
    } else if (message.kind === "job_picture" && message.job === this.job) {
      this.shown = canvasOf(payload, message.width, message.height);
    } else {
      this.onMessage(message, payload);
    }
  }

  protected onMessage(_message: ToPage, _payload: Payload): void {}

  private async load(job: Job): Promise<void> {
    const address = Math.max(...this.size) > EXEMPLAR ? pictureAddress(job.texture, EXEMPLAR) : fileAddress(job.id, "texture.png");
    const loaded = await this.studio.attempt(bitmap(address));
    if (loaded && job.id === this.job) this.shown = loaded;
  }

  private async recipe(): Promise<Recipe | undefined> {
    const draft = await this.draft();
    if (typeof draft !== "string") return this.studio.attempt(kept(draft));
    this.problem = draft;
    return undefined;
  }

  private async finish(): Promise<void> {
    const job = await this.studio.start(await this.recipe());
    if (!job) return;
    this.studio.stopPreview();
    [this.job, this.number, this.done, this.isRefined] = [job.id, -1, 1, false];
  }

  private async showRecipe(): Promise<void> {
    await this.studio.show(await this.recipe());
  }

  private edit(change: Partial<Recipe>): void {
    const { size, ...others } = change;
    this.form = { ...this.form, ...others };
    if (size) this.resize(sides(size));
    this.changed();
  }

  protected resize(size: [number, number]): void {
    this.size = size;
  }

  // -- how it looks

  /** Show what is being drawn, without waiting for an update. */
  protected redraw(): void {
    this.querySelectorAll<PictureView>("picture-view").forEach((view) => view.draw());
    this.requestUpdate();
  }

  protected abstract tools(): TemplateResult;
  protected abstract panes(): TemplateResult;
  protected abstract readonly history: { canUndo: boolean; canRedo: boolean };
  /** What to do first. */
  protected abstract hint(): string;

  override render(): TemplateResult {
    const job = this.studio.jobs.get(this.job);
    const isBusy = job?.state === "waiting" || job?.state === "running";
    const method: Method = {
      flow: "", about: "", exemplar: "exemplar", begins: "picture", has_maps: false, tiles: false, size: sizeText(this.size), can_tile: true, presets: this.presets, uniformity: "", default_uniformity: 0, others: [],
      several: null, choices: [], controls: [], views: [], is_texture: true, can_correct: false,
    };
    return html`
      <section class="stage" aria-label=${MODES[this.name]}>
        <div class="bar">
          ${choice("Mode", MODES, this.name, (mode) => this.tell("mode", mode))}
          ${undoButtons(this.history, (direction) => this.stepBy(direction))}
          <span class="state" role="status">${this.status(job)}</span>
        </div>
        <div class="panes">${this.exemplar ? this.panes() : html`<p class="welcome" role="status">Loading the exemplar …</p>`}</div>
        ${this.done < 1 && !this.job ? html`<progress class="line" max="1" .value=${this.done} aria-label="Preview"></progress>` : nothing}
      </section>
      <aside class="right" aria-label="${MODES[this.name]}: tools">
        ${this.tools()}
        <recipe-form .recipe=${{ ...this.form, flow: "", sources: {}, size: sizeText(this.size) } as Recipe} .method=${method}
          @edit=${(event: CustomEvent<Partial<Recipe>>) => this.edit(event.detail)}></recipe-form>
        <button class="primary" ?disabled=${isBusy} @click=${() => this.finish()}>Finish at full size</button>
        ${job?.state === "done" ? html`<button @click=${() => this.tell("inspect", `job:${job.id}`)}>Inspect it</button>` : nothing}
        ${job ? html`<job-panel .studio=${this.studio} .job=${job}></job-panel>` : nothing}
        <button @click=${() => this.showRecipe()}>Show as YAML or command</button>
      </aside>
    `;
  }

  private status(job?: Job): string | TemplateResult {
    if (this.problem) return this.failed ? failure(this.problem, this.failed) : this.problem;
    if (job?.state === "done") return "Full size";
    if (job?.state === "running") return "Running at full size; scales appear as they finish";
    if (this.done < 1) return this.shown ? "Refining the preview …" : "Preparing the first preview …";
    if (this.isRefined) return "Preview; a finer one is being made …";
    return this.shown ? "Preview; the full size has its own details" : this.hint();
  }
}
