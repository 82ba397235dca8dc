// Make: a larger or tileable texture of one exemplar, with a preview that follows every change.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Element } from "./element";
import type { CorrectPanel } from "./correct-panel";
import "./correct-panel";
import { failure, isTyping, undoButtons } from "./fields";
import "./job-panel";
import type { BadPlace, Job, Method, Picture, PreviewPicture, Recipe, ToPage } from "./messages";
import "./picture-list";
import type { Drawable, Mode, Patch, Point } from "./picture-view";
import "./picture-view";
import "./recipe-form";
import { bitmap, fileAddress, insight, pictureAddress } from "./server";
import { sides, sizeText } from "./sizes";
import "./source-inset";
import { canvasOf, type Payload, type Studio } from "./studio";
import { Undo } from "./undo";

const MODES: Record<Mode | "seeds", string> = { single: "Single", repeat: "Repeat", compare: "Compare", seeds: "Seeds" };
const EXEMPLAR = 1024; // px of the exemplar that is shown, at most
const NONE: Point[] = [];
const SEEDS = 9; // of a contact sheet

interface Sheet {
  pictures: (Drawable | null)[];
  first: number;
  waiting: number;
}

@customElement("make-view")
export class MakeView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @state() private undo = new Undo<Recipe | null>(null);
  @state() private mode: Mode | "seeds" = "single";
  @state() private preview: Drawable | null = null;
  @state() private previewScale = 1;
  @state() private done = 1;
  @state() private problem = "";
  @state() private exemplar: ImageBitmap | null = null;
  /** the runs whose results are shown: at full size, and after each correction */
  @state() private results = new Undo<string>("");
  @state() private isCorrecting = false;
  @state() private outline: Point[] = [];
  @state() private patch: Patch | null = null;
  @state() private places: BadPlace[] = [];
  @state() private marksPlaces = localStorage.getItem("worst places") === "marked";
  @state() private origins: Uint16Array | null = null;
  @state() private hovered: Point | null = null;
  @state() private result: Drawable | null = null;
  /** whether `result` is the finished picture, not one of a scale */
  @state() private isWhole = false;
  @state() private sheet: Sheet | null = null;
  @query("correct-panel") private panel!: CorrectPanel;
  /** the results of each recipe, by its JSON, so that nothing is lost when a setting is changed and changed back */
  private readonly made = new Map<string, Undo<string>>();
  /** the worst places that corrections have left, by run */
  private readonly left = new Map<string, BadPlace[]>();
  private number = 0;
  private stop: (() => void) | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.stop = this.studio.listen((message, payload) => this.receive(message, payload));
    this.studio.addEventListener("change", () => this.requestUpdate());
    window.addEventListener("keydown", this.key);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.stop?.();
    window.removeEventListener("keydown", this.key);
  }

  private get recipe(): Recipe | null {
    return this.undo.now;
  }

  private get job(): string {
    return this.results.now;
  }

  private get method(): Method {
    const { methods } = this.studio.begin;
    return methods.find((one) => one.flow === this.recipe?.flow) ?? methods[0];
  }

  /** What has still to be chosen before anything can be made. */
  private get lacking(): string {
    return this.method.others.find((one) => one.is_required && !this.recipe?.sources[one.source])?.about ?? "";
  }

  private get exemplarId(): string {
    return Object.values(this.recipe?.sources ?? {})[0] ?? "";
  }

  // -- what the user does

  private choose(picture: Picture): void {
    const flow = picture.is_material ? "materials" : this.recipe && !isMaterial(this.recipe) ? this.recipe.flow : "self_tuning";
    const method = this.studio.begin.methods.find((one) => one.flow === flow)!;
    const size = this.recipe?.size ?? doubled(picture, method);
    this.edit({ ...this.recipe, flow, sources: { ...this.recipe?.sources, exemplar: picture.id }, size });
  }

  private edit(change: Partial<Recipe>): void {
    const recipe = { seed: 7, ...this.recipe, ...change } as Recipe;
    if (change.flow && change.flow !== this.recipe?.flow) {
      const method = this.studio.begin.methods.find((one) => one.flow === change.flow)!;
      recipe.preset = method.presets.includes(recipe.preset ?? "") ? recipe.preset : null;
      recipe.params = method.uniformity ? recipe.params : {};
      recipe.tileable = method.can_tile ? recipe.tileable : null;
      const taken = ["exemplar", ...method.others.map((one) => one.source)];
      recipe.sources = Object.fromEntries(Object.entries(recipe.sources).filter(([name]) => taken.includes(name)));
    }
    this.undo.set(recipe);
    this.refresh();
  }

  private step(direction: "undo" | "redo"): void {
    const isOfResults = direction === "undo" ? this.results.canUndo : this.results.canRedo;
    if (isOfResults) {
      this.results[direction]();
      this.shownAgain();
    } else {
      this.undo[direction]();
      this.refresh();
    }
  }

  /** Show the result of the current run, after corrections were taken or undone. */
  private shownAgain(): void {
    this.endCorrection();
    const job = this.studio.jobs.get(this.job);
    if (job?.state === "done") void this.loadResult(job);
    this.requestUpdate();
  }

  private endCorrection(): void {
    this.isCorrecting = false;
    this.outline = [];
    this.patch = null;
  }

  private async accept(recipe: Recipe | null): Promise<void> {
    if (!recipe) {
      this.endCorrection();
      return;
    }
    const job = await this.studio.start(recipe);
    if (!job) return;
    this.left.set(job.id, outside(this.outline, this.places));
    this.isCorrecting = false;
    this.outline = [];
    this.results.set(job.id);
    this.requestUpdate();
  }

  private readonly key = (event: KeyboardEvent): void => {
    if (this.hidden || isTyping(event) || event.ctrlKey || event.metaKey) return;
    const key = event.key.toLowerCase();
    if (key === "w") this.markPlaces();
    else if (key === "n" && this.recipe) this.edit({ seed: (this.recipe.seed ?? 7) + 1 });
  };

  /** Show what the recipe gives now. */
  private refresh(): void {
    const recipe = this.recipe;
    this.problem = "";
    this.forgetResult();
    this.sheet = null;
    if (this.mode !== "seeds") this.results = this.made.get(JSON.stringify(recipe)) ?? this.results;
    if (!recipe) {
      this.preview = null;
      this.requestUpdate();
      return;
    }
    const job = this.studio.jobs.get(this.job);
    if (this.lacking) [this.preview, this.done] = [null, 1];
    else if (this.mode === "seeds") this.beginSheet();
    else if (job?.state === "done") void this.loadResult(job);
    else this.ask(recipe);
    void this.loadExemplar();
    this.requestUpdate();
  }

  private forgetResult(): void {
    this.results = new Undo<string>("");
    [this.result, this.isWhole] = [null, false];
    this.places = [];
    this.origins = null;
    this.endCorrection();
  }

  private ask(recipe: Recipe): void {
    this.done = 0;
    this.number = this.studio.preview(recipe);
  }

  private async loadExemplar(): Promise<void> {
    const id = this.exemplarId;
    const loaded = await this.studio.attempt(bitmap(pictureAddress(id, EXEMPLAR)));
    if (loaded && id === this.exemplarId) this.exemplar = loaded;
  }

  private chooseMode(mode: Mode | "seeds"): void {
    const wasSheet = this.mode === "seeds";
    this.mode = mode;
    if (mode === "seeds") {
      this.beginSheet();
    } else if (wasSheet) {
      this.refresh();
    }
  }

  private beginSheet(): void {
    const first = this.recipe?.seed ?? 7;
    this.forgetResult();
    this.sheet = { pictures: Array<Drawable | null>(SEEDS).fill(null), first, waiting: 0 };
    this.ask({ ...this.recipe!, seed: first });
  }

  private async finish(): Promise<void> {
    const recipe = this.recipe!;
    const job = await this.studio.start(recipe);
    if (!job) return;
    this.results = new Undo(job.id);
    this.made.set(JSON.stringify(recipe), this.results);
    if (this.sheet) [this.sheet, this.mode] = [null, "single"];
  }

  private markPlaces(): void {
    this.marksPlaces = !this.marksPlaces;
    localStorage.setItem("worst places", this.marksPlaces ? "marked" : "");
  }

  private correct(): void {
    this.mode = "single";
    this.isCorrecting = true;
  }

  // -- what the server says

  private receive(message: ToPage, payload: Payload): void {
    switch (message.kind) {
      case "preview_picture":
        if (message.number === this.number) this.onPreview(message, payload);
        break;
      case "preview_failed":
        if (message.number === this.number) {
          this.problem = message.problem;
          this.done = 1;
        }
        break;
      case "job_picture":
        if (message.job === this.job && !this.results.canUndo) [this.result, this.isWhole] = [canvasOf(payload, message.width, message.height), false];
        break;
      case "job_changed":
        if (message.job.id === this.job && message.job.state === "done") void this.loadResult(message.job);
        break;
    }
  }

  private onPreview(message: PreviewPicture, payload: Payload): void {
    const picture = canvasOf(payload, message.width, message.height);
    this.done = message.is_final ? 1 : message.done;
    this.previewScale = message.scale;
    if (!this.sheet) {
      this.preview = picture;
      return;
    }
    const { pictures, waiting, first } = this.sheet;
    pictures[waiting] = picture;
    if (message.is_final && waiting + 1 < SEEDS) {
      this.sheet = { pictures, first, waiting: waiting + 1 };
      this.ask({ ...this.recipe!, seed: first + waiting + 1 });
    }
    this.requestUpdate();
  }

  private async loadResult(job: Job): Promise<void> {
    const file = job.files.find((one) => one === "texture.png");
    const loaded = file && (await this.studio.attempt(bitmap(fileAddress(job.id, file))));
    if (!loaded || job.id !== this.job) return;
    [this.result, this.isWhole] = [loaded, true];
    this.patch = null;
    [this.places, this.origins] = [this.left.get(job.id) ?? [], null];
    const told = !this.left.has(job.id) && (await this.studio.attempt(insight(job.id)));
    if (!told || job.id !== this.job) return;
    this.places = told[0].places;
    if (told[0].height === loaded.height && told[1].length) this.origins = told[1];
  }

  // -- how it looks

  override render(): TemplateResult {
    return html`
      <aside class="left" aria-label="Pictures">
        <picture-list .studio=${this.studio} .chosen=${this.exemplarId}
          @choose=${(event: CustomEvent<Picture>) => this.choose(event.detail)}></picture-list>
      </aside>
      <section class="stage" aria-label="Texture">
        ${this.recipe ? this.stage() : this.welcome()}
      </section>
      <aside class="right" aria-label="Settings">${this.recipe ? this.settings(this.recipe) : nothing}</aside>
    `;
  }

  private welcome(): TemplateResult {
    return html`<div class="welcome">
      <h2>Make a texture of a picture</h2>
      <p>Drop a picture of a material on the left, or choose an example. It should show the material from the front,
        evenly lit, with its structure repeated a few times.</p>
    </div>`;
  }

  private stage(): TemplateResult {
    const { undo, results } = this;
    const shown = this.result ?? this.preview;
    const factor = this.result ? 1 : this.previewScale;
    const exemplarWidth = this.studio.picture(this.exemplarId)?.width ?? 1;
    const wholeWidth = this.result ? sides(this.recipe!.size ?? this.method.size)[1] : 1;
    const perPixel = (exemplarWidth / (this.exemplar?.width ?? exemplarWidth)) * factor;
    return html`
      <div class="bar">
        <div class="segments" role="radiogroup" aria-label="How to look at it">
          ${(Object.keys(MODES) as (Mode | "seeds")[]).map((mode) => html`<button role="radio"
            aria-checked=${this.mode === mode} @click=${() => this.chooseMode(mode)}>${MODES[mode]}</button>`)}
        </div>
        ${undoButtons({ canUndo: undo.canUndo || results.canUndo, canRedo: undo.canRedo || results.canRedo }, (direction) => this.step(direction))}
        ${this.result && this.places.length && this.mode === "single"
          ? html`<button class="quiet" title="Mark the places least like the exemplar (W)" aria-pressed=${this.marksPlaces} @click=${() => this.markPlaces()}>Worst places</button>`
          : nothing}
        <span class="state" role="status">${this.status()}</span>
      </div>
      ${this.sheet ? this.contactSheet(this.sheet) : html`<picture-view
        .picture=${shown}
        .exemplar=${this.exemplar}
        .exemplarScale=${this.result && shown ? (perPixel * shown.width) / wholeWidth : perPixel}
        .mode=${this.mode as Mode}
        .tool=${this.isCorrecting ? "lasso" : "pan"}
        .outline=${this.outline}
        .patch=${this.patch}
        .marks=${(this.isCorrecting || this.marksPlaces) && this.result && !this.outline.length ? this.places.map(({ row, column }) => ({ x: column, y: row })) : NONE}
        @lasso=${(event: CustomEvent<Point[]>) => {
          this.outline = event.detail;
          void this.panel.begin(event.detail);
        }}
        @hover=${(event: CustomEvent<Point | null>) => (this.hovered = event.detail)}
        label=${this.result ? "Texture at full size" : "Preview"}
      ></picture-view>`}
      ${shown || this.sheet ? nothing : html`<p class="welcome over">${this.problem || this.waits}</p>`}
      ${this.origins && this.result && this.exemplar && this.hovered && !this.isCorrecting
        ? html`<source-inset .exemplar=${this.exemplar} .origins=${this.origins} .place=${this.hovered}
            .size=${[this.result.height, this.result.width]} .scale=${exemplarWidth / this.exemplar.width}></source-inset>`
        : nothing}
      ${this.done < 1 && !this.job ? html`<progress class="line" max="1" .value=${this.done} aria-label="Preview"></progress>` : nothing}
    `;
  }

  /** What is shown before there is a picture. */
  private get waits(): string {
    if (this.lacking) return `Choose a picture on the right: ${this.lacking.toLowerCase()}`;
    return this.job ? "The first scale is being made …" : "The exemplar is being analysed …";
  }

  private again(): void {
    [this.problem, this.done] = ["", 0];
    this.studio.repeat(this.number);
  }

  private status(): string | TemplateResult {
    const job = this.studio.jobs.get(this.job);
    if (this.problem) return failure(this.problem, () => this.again());
    if (this.lacking) return `Choose: ${this.lacking.toLowerCase()}`;
    if (job?.state === "done") return this.results.canUndo ? "Full size, corrected" : `Full size, seed ${job.recipe.seed}`;
    if (job?.recipe.flow === "revise" && this.job) return "Keeping the correction …";
    if (job?.state === "running") return "Running at full size; scales appear as they finish";
    if (this.done < 1) return this.preview ? "Refining the preview …" : "Preparing the first preview …";
    const percent = Math.round(100 * this.previewScale);
    return percent < 100 ? `Preview at ${percent} % of the size; the full size has its own details` : "Preview";
  }

  private contactSheet(sheet: Sheet): TemplateResult {
    return html`<div class="sheet">
      ${sheet.pictures.map((picture, index) => html`<button
        title="Take seed ${sheet.first + index}"
        @click=${() => {
          this.mode = "single";
          this.edit({ seed: sheet.first + index });
        }}>
        <picture-view .picture=${picture} inert label="Seed ${sheet.first + index}"></picture-view>
        <span>Seed ${sheet.first + index}</span>
      </button>`)}
    </div>`;
  }

  private settings(recipe: Recipe): TemplateResult {
    const job = this.studio.jobs.get(this.job);
    const isBusy = job?.state === "waiting" || job?.state === "running";
    if (this.isCorrecting && job && this.result) {
      return html`<correct-panel .studio=${this.studio} .job=${job} .places=${this.places}
        .size=${[this.result.height, this.result.width]}
        @outline=${(event: CustomEvent<Point[]>) => (this.outline = event.detail)}
        @patch=${(event: CustomEvent<Patch | null>) => (this.patch = event.detail)}
        @accept=${(event: CustomEvent<Recipe | null>) => this.accept(event.detail)}></correct-panel>`;
    }
    const isMaps = this.studio.picture(this.exemplarId)?.is_material ?? false;
    const methods = this.studio.begin.methods.filter((one) => isMaps || one.flow !== "materials");
    return html`
      <recipe-form .recipe=${recipe} .method=${this.method} .methods=${methods} .pictures=${[...this.studio.pictures, ...this.studio.begin.examples]}
        @edit=${(event: CustomEvent<Partial<Recipe>>) => this.edit(event.detail)}></recipe-form>
      <button class="primary" ?disabled=${isBusy || this.lacking !== ""} @click=${() => this.finish()}>Finish at full size</button>
      ${job?.state === "done"
        ? html`<p class="row"><button class="half" ?disabled=${!this.isWhole} @click=${() => this.correct()}>Correct a spot</button>
            <button class="half" @click=${() => this.tell("inspect", `job:${job.id}`)}>Look at it in 3D</button></p>`
        : nothing}
      ${job ? html`<job-panel .studio=${this.studio} .job=${job}></job-panel>` : nothing}
      <button @click=${() => this.studio.show(job?.recipe ?? recipe)}>Show as YAML or command</button>
    `;
  }
}

const isMaterial = (recipe: Recipe): boolean => recipe.flow === "materials";

/** The places that are not inside of an outline. */
function outside(outline: Point[], places: BadPlace[]): BadPlace[] {
  const path = new Path2D();
  outline.forEach(({ x, y }) => path.lineTo(x, y));
  const context = new OffscreenCanvas(1, 1).getContext("2d")!;
  return places.filter(({ row, column }) => !context.isPointInPath(path, column, row));
}

/** Twice the exemplar in round numbers, but no more than the method's own size. */
function doubled(picture: Picture, method: Method): string {
  const side = 2 ** Math.round(Math.log2(2 * Math.max(picture.height, picture.width)));
  const size = Math.min(Math.max(...sides(method.size)), Math.max(256, side));
  return sizeText([size, size]);
}
