// Make: textures of one picture or of several, with a preview that follows every change.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import type { CorrectPanel } from "./correct-panel";
import "./correct-panel";
import { Element } from "./element";
import { failure, isTyping } from "./fields";
import "./make-settings";
import { statusOf, waitsFor } from "./make-status";
import { modesOf, type Shown, WELCOME } from "./make-stage";
import "./make-stage";
import { MadeResults, TEXTURE } from "./made-results";
import type { Method, Picture, PreviewPicture, Recipe, ToPage } from "./messages";
import "./picture-list";
import type { Drawable, Patch, Point } from "./picture-view";
import { isFull, lacking, picturesOf, toggled, tooMany, withExemplar, withMethod } from "./recipe-edits";
import { newSheet, type Sheet, withSeed } from "./seed-sheet";
import { bitmap, pictureAddress, RequestError } from "./server";
import { canvasOf, type Payload, type Studio } from "./studio";
import { Undo } from "./undo";

const EXEMPLAR = 1024; // px of the exemplar that is shown, at most
@customElement("make-view")
export class MakeView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @state() private undo = new Undo<Recipe | null>(null);
  @state() private mode: Shown = "single";
  @state() private preview: Drawable | null = null;
  @state() private previewScale = 1;
  @state() private done = 1;
  @state() private problem = "";
  @state() private exemplar: ImageBitmap | null = null;
  /** the export that is shown of a result */
  @state() private file = "";
  @state() private isCorrecting = false;
  @state() private outline: Point[] = [];
  @state() private patch: Patch | null = null;
  @state() private sheet: Sheet | null = null;
  @query("correct-panel") private panel!: CorrectPanel;
  private results!: MadeResults;
  private number = 0;
  private previewed = ""; // the flow of `preview`
  private stop: (() => void) | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.results ??= new MadeResults(this.studio, () => this.requestUpdate());
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

  private get method(): Method {
    const { methods } = this.studio.begin;
    return methods.find((one) => one.flow === this.recipe?.flow) ?? methods[0];
  }

  private get lacking(): string {
    return lacking(this.recipe, this.method);
  }

  private get exemplarId(): string {
    return picturesOf(this.recipe)[0] ?? "";
  }

  // -- what the user does

  /** Take a picture that was clicked or dropped: as the exemplar, or as one of several. */
  private choose(picture: Picture, isDropped = false): void {
    const { recipe, method } = this;
    if (!recipe || !method.several) this.edit(withExemplar(recipe, picture, this.studio.begin.methods));
    else if (isDropped && picturesOf(recipe).includes(picture.id)) return;
    else if (isFull(recipe, method) && !picturesOf(recipe).includes(picture.id)) this.studio.problem(new RequestError(tooMany(picture, method)));
    else this.edit(toggled(recipe, method, picture.id));
  }

  private edit(change: Partial<Recipe>): void {
    let recipe = { ...this.recipe, ...change } as Recipe;
    if (recipe.flow !== this.recipe?.flow && this.recipe) {
      recipe = withMethod(recipe, this.studio.begin.methods.find((one) => one.flow === recipe.flow)!);
    }
    this.undo.set(recipe);
    if (!(this.mode in this.modes)) this.mode = "single";
    this.refresh();
  }

  private step(direction: "undo" | "redo"): void {
    const { runs } = this.results;
    if (direction === "undo" ? runs.canUndo : runs.canRedo) {
      runs[direction]();
      this.endCorrection();
      this.load();
      this.requestUpdate();
    } else {
      this.undo[direction]();
      this.refresh();
    }
  }

  /** Load what is shown of a run that is done. */
  private load(): void {
    const { job } = this.results;
    if (job?.state !== "done") return;
    const file = job.recipe.flow === this.recipe?.flow ? this.shownFile : TEXTURE; // a correction has the texture alone
    void this.results.load(job, file).then(() => (this.patch = null));
  }

  private get shownFile(): string {
    const files = this.results.job?.files ?? [];
    const views = this.method.views.filter((one) => !files.length || files.includes(one.file));
    return (views.find((one) => one.file === this.file) ?? views[0])?.file ?? TEXTURE;
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
    this.results.correct(job, this.outline);
    this.isCorrecting = false;
    this.outline = [];
    this.requestUpdate();
  }

  private readonly key = (event: KeyboardEvent): void => {
    if (this.hidden || isTyping(event) || event.ctrlKey || event.metaKey) return;
    if (event.key.toLowerCase() === "n" && this.recipe) this.edit({ seed: (this.recipe.seed ?? 7) + 1 });
  };

  /** Show what the recipe gives now. */
  private refresh(): void {
    const recipe = this.recipe;
    if (recipe?.flow !== this.previewed) [this.preview, this.file] = [null, ""]; // of another method
    [this.problem, this.previewed] = ["", recipe?.flow ?? ""];
    this.results.forget();
    this.endCorrection();
    this.sheet = null;
    if (this.mode !== "seeds") this.results.recall(recipe);
    this.requestUpdate();
    if (!recipe) return;
    if (this.lacking) [this.preview, this.done, this.number] = [null, 1, 0];
    else if (this.mode === "seeds") this.beginSheet();
    else if (this.results.job?.state === "done") this.load();
    else this.ask(recipe);
    void this.loadExemplar();
  }

  private ask(recipe: Recipe): void {
    this.done = 0;
    this.number = this.studio.preview(recipe);
  }

  private async loadExemplar(): Promise<void> {
    const id = this.exemplarId;
    const loaded = id && (await this.studio.attempt(bitmap(pictureAddress(id, EXEMPLAR))));
    if (loaded && id === this.exemplarId) this.exemplar = loaded;
  }

  private chooseMode(mode: Shown): void {
    const wasSheet = this.mode === "seeds";
    this.mode = mode;
    if (mode === "seeds") this.beginSheet();
    else if (wasSheet) this.refresh();
  }

  private chooseFile(file: string): void {
    this.file = file;
    this.load();
  }

  private beginSheet(): void {
    if (this.lacking) return;
    this.results.forget();
    this.endCorrection();
    this.sheet = newSheet(this.recipe?.seed ?? 7);
    this.ask({ ...this.recipe!, seed: this.sheet.first });
  }

  private async finish(): Promise<void> {
    const recipe = this.recipe!;
    const job = await this.studio.start(recipe);
    if (!job) return;
    this.results.begin(recipe, job);
    if (this.sheet) [this.sheet, this.mode] = [null, "single"];
    this.requestUpdate();
  }

  private correct(): void {
    this.mode = "single";
    if (this.file) this.chooseFile("");
    this.isCorrecting = true;
  }

  // -- what the server says

  private receive(message: ToPage, payload: Payload): void {
    this.results.receive(message, payload);
    if (message.kind === "preview_picture" && message.number === this.number) this.onPreview(message, payload);
    else if (message.kind === "preview_failed" && message.number === this.number) [this.problem, this.done, this.preview] = [message.problem, 1, null];
    else if (message.kind === "job_changed" && message.job.id === this.results.id) this.load();
  }

  private onPreview(message: PreviewPicture, payload: Payload): void {
    const picture = canvasOf(payload, message.width, message.height);
    this.done = message.is_final ? 1 : message.done;
    this.previewScale = message.scale;
    if (!this.sheet) {
      this.preview = picture;
      return;
    }
    const { waiting } = this.sheet;
    this.sheet = withSeed(this.sheet, picture, message.is_final);
    if (this.sheet.waiting > waiting) this.ask({ ...this.recipe!, seed: this.sheet.first + this.sheet.waiting });
  }

  // -- how it looks

  override render(): TemplateResult {
    return html`
      <aside class="left" aria-label="Pictures">
        <picture-list .studio=${this.studio} .chosen=${picturesOf(this.recipe)} .takesSeveral=${this.method.several !== null && this.recipe !== null}
          @choose=${(event: CustomEvent<Picture>) => this.choose(event.detail)}
          @add=${(event: CustomEvent<Picture>) => this.choose(event.detail, true)}></picture-list>
      </aside>
      <section class="stage" aria-label="Texture">
        ${this.recipe ? this.stage() : WELCOME}
      </section>
      <aside class="right" aria-label="Settings">${this.recipe ? this.settings(this.recipe) : nothing}</aside>
    `;
  }

  private get modes(): Partial<Record<Shown, string>> {
    return modesOf(this.method);
  }

  private stage(): TemplateResult {
    const { undo, results } = this;
    const history = { canUndo: undo.canUndo || results.runs.canUndo, canRedo: undo.canRedo || results.runs.canRedo };
    return html`<make-stage .studio=${this.studio} .recipe=${this.recipe} .method=${this.method} .results=${results} .history=${history}
      .mode=${this.mode} .modes=${this.modes} .file=${this.shownFile} .sheet=${this.sheet}
      .preview=${this.preview} .previewScale=${this.previewScale} .exemplar=${this.exemplar} .done=${this.done}
      .status=${this.status()} .waits=${this.problem || waitsFor(this.lacking, this.results)}
      .isCorrecting=${this.isCorrecting} .outline=${this.outline} .patch=${this.patch}
      @mode=${(event: CustomEvent<Shown>) => this.chooseMode(event.detail)}
      @step=${(event: CustomEvent<"undo" | "redo">) => this.step(event.detail)}
      @file=${(event: CustomEvent<string>) => this.chooseFile(event.detail)}
      @seed=${(event: CustomEvent<number>) => this.takeSeed(event.detail)}
      @lasso=${(event: CustomEvent<Point[]>) => {
        this.outline = event.detail;
        void this.panel.begin(event.detail);
      }}></make-stage>`;
  }

  private takeSeed(seed: number): void {
    this.mode = "single";
    this.edit({ seed });
  }

  private again(): void {
    [this.problem, this.done] = ["", 0];
    this.studio.repeat(this.number);
  }

  private status(): string | TemplateResult {
    if (this.problem) return failure(this.problem, () => this.again());
    return statusOf(this.results, this.lacking, this.done < 1, this.preview ? this.previewScale : 0);
  }

  private settings(recipe: Recipe): TemplateResult {
    const { job, picture, places, isWhole } = this.results;
    if (this.isCorrecting && job && picture) {
      return html`<correct-panel .studio=${this.studio} .job=${job} .places=${places} .size=${[picture.height, picture.width]}
        @outline=${(event: CustomEvent<Point[]>) => (this.outline = event.detail)}
        @patch=${(event: CustomEvent<Patch | null>) => (this.patch = event.detail)}
        @accept=${(event: CustomEvent<Recipe | null>) => this.accept(event.detail)}></correct-panel>`;
    }
    return html`<make-settings .studio=${this.studio} .recipe=${recipe} .method=${this.method} .job=${job} .isWhole=${isWhole} .lacking=${this.lacking}
      @edit=${(event: CustomEvent<Partial<Recipe>>) => this.edit(event.detail)}
      @finish=${() => this.finish()} @correct=${() => this.correct()}></make-settings>`;
  }
}
