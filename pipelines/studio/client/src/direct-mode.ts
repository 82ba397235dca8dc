// What the layers share that have a preview: the size of the result, pictures beside each other, and what is drawn over them.
import { html, nothing, type TemplateResult } from "lit";
import { state } from "lit/decorators.js";
import { type Draft, kept } from "./drafts";
import { card, failure, isTyping, undoButtons } from "./fields";
import { KIND, LAYERS, type LayerName } from "./layers";
import { viewed } from "./large-pictures";
import { MaterialLayer } from "./material-layer";
import type { Drawing, Job, Method, Recipe, ToPage } from "./messages";
import type { Drawable, PictureView } from "./picture-view";
import "./picture-view";
import "./recipe-form";
import { bitmap, fileAddress, pictureAddress } from "./server";
import { screenPixels, sides, sizeText } from "./sizes";
import { canvasOf, isFollowed, type Payload } from "./studio";
import type { Tiles } from "./tiles";

const EXEMPLAR = 2048; // px of the exemplar that is shown, at most
const PAUSE = 1000; // ms without a stroke until the material has what is drawn

export abstract class DirectMode extends MaterialLayer {
  @state() protected exemplar: ImageBitmap | null = null;
  protected exemplarTiles: Tiles | null = null;
  /** what the material shows, the preview, or the result at full size */
  @state() protected shown: Drawable | null = null;
  @state() protected size: [number, number] = [512, 512];
  @state() private form: Partial<Recipe> = {};
  @state() private done = 1;
  /** whether a finer preview follows */
  @state() private isRefined = false;
  @state() private problem = "";
  /** what to try again, where the server has failed */
  protected failed: (() => void) | null = null;
  /** the flow that takes what is drawn */
  protected abstract readonly flow: string;
  protected abstract override readonly layer: Exclude<LayerName, "surfaces">;
  private number = -1;
  private turn = 0;
  /** whether the recipe of the material lacks what is drawn */
  private isNew = false;
  private timer = 0;

  /** What would be made now; a text says what is missing. */
  protected abstract draft(): Promise<Draft | string>;
  /** Begin with another exemplar. */
  protected abstract reset(): void;
  /** What is drawn, as the project keeps it beside the recipe. */
  protected abstract drawing(): Partial<Drawing>;
  /** Go on with what was drawn before the page was loaded. */
  protected restore(_drawing: Drawing): void {}

  private get method(): Method {
    return this.studio.begin.methods.find(({ flow }) => flow === this.flow)!;
  }

  protected override willUpdate(changed: Map<string, unknown>): void {
    super.willUpdate(changed);
    if (changed.has("recipe") && !this.isNew) this.sync();
    if (changed.has("begun") && !this.isNew && !this.job) [this.shown, this.number] = [this.begun, -1];
  }

  /** Take the settings of the material. */
  private sync(): void {
    const { recipe, method } = this;
    const { [KIND]: _, ...params } = recipe.params ?? {};
    const size = sides(recipe.size ?? method.size!);
    if (size.some((side, axis) => side !== this.size[axis])) this.resize(size);
    const preset = method.presets.includes(recipe.preset ?? "") ? recipe.preset : null;
    this.form = { seed: recipe.seed, tileable: recipe.tileable, preset, params: recipe.flow === this.flow ? params : {} };
  }

  protected override async open(): Promise<void> {
    const { picture } = this;
    [this.exemplar, this.shown, this.job, this.problem, this.done, this.number, this.isNew] = [null, this.begun, "", "", 1, -1, false];
    this.reset();
    this.sync();
    if (this.kept) this.restore(this.kept);
    const loaded = await this.studio.attempt(viewed(picture.id, picture, EXEMPLAR));
    if (loaded && picture === this.picture) [this.exemplar, this.exemplarTiles] = [loaded.picture, loaded.tiles];
  }

  // -- keys

  protected override onWindowKey(event: KeyboardEvent): void {
    if (!this.querySelector("section")?.offsetParent) return; // another layer is shown
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
    [this.job, this.isNew] = ["", true];
    this.requestUpdate();
    this.keep(this.drawing());
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.keepDraft(), PAUSE);
    void this.ask();
  }

  /** Let the project have the recipe of what is drawn, with which another page would go on. */
  private async keepDraft(): Promise<void> {
    const recipe = await this.described();
    if (recipe && this.isNew && this.isConnected) this.studio.project.edit({ draft: recipe });
  }

  /** The recipe of what is drawn; none where something is missing. */
  private async described(): Promise<Recipe | undefined> {
    const draft = await this.draft();
    return typeof draft === "string" ? undefined : this.studio.attempt(kept(draft));
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    clearTimeout(this.timer);
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

  protected base(flow: string, sources: Recipe["sources"] = {}, params: Recipe["params"] = {}): Recipe {
    return { ...this.form, flow, sources: { exemplar: this.picture.id, ...sources }, size: sizeText(this.size), params: { ...this.form.params, ...params } };
  }

  protected override receive(message: ToPage, payload: Payload): void {
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

  protected override async drawn(): Promise<Recipe | undefined> {
    const draft = await this.draft();
    if (typeof draft !== "string") return this.studio.attempt(kept(draft));
    this.problem = draft;
    return undefined;
  }

  protected override async finish(): Promise<void> {
    await super.finish();
    if (!this.job) return;
    this.studio.stopPreview();
    [this.number, this.done, this.isRefined, this.isNew] = [-1, 1, false, false];
  }

  /** The material goes on with what is drawn. */
  protected override async leave(layer: LayerName): Promise<void> {
    const recipe = this.isNew && (await this.described());
    if (recipe) this.tell("drawn", recipe);
    this.isNew = false;
    await super.leave(layer);
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
    const name = LAYERS[this.layer];
    return html`
      <section class="stage" aria-label=${name}>
        <div class="bar">
          ${undoButtons(this.history, (direction) => this.stepBy(direction))}
          <span class="state" role="status">${this.status(this.run)}</span>
        </div>
        <div class="panes">${this.exemplar ? this.panes() : html`<p class="welcome" role="status">Loading the exemplar …</p>`}</div>
        ${this.done < 1 && !this.job ? html`<progress class="line" max="1" .value=${this.done} aria-label="Preview"></progress>` : nothing}
      </section>
      <aside class="right" aria-label="${name}: tools">
        ${this.cards(this.tools())}
        ${card("Make", "", true, html`<recipe-form .recipe=${this.base(this.flow)} .method=${this.method}
          @edit=${(event: CustomEvent<Partial<Recipe>>) => this.edit(event.detail)}></recipe-form>`)}
        ${this.ending("Finish at full size")}
      </aside>
    `;
  }

  private status(job?: Job): string | TemplateResult {
    if (this.problem) return this.failed ? failure(this.problem, this.failed) : this.problem;
    if (job?.state === "done") return "Full size";
    if (job?.state === "running") return "Running at full size; scales appear as they finish";
    if (this.done < 1) return this.shown ? "Refining the preview …" : "Preparing the first preview …";
    if (this.isRefined) return "Preview; a finer one is being made …";
    return this.shown && this.number >= 0 ? "Preview; the full size has its own details" : this.hint();
  }
}
