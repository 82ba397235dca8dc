// Make: textures of one picture or of several, with a preview that follows every change.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Comparison } from "./comparison";
import type { CorrectPanel } from "./correct-panel";
import "./correct-panel";
import { Element } from "./element";
import { failure } from "./fields";
import "./make-settings";
import { statusOf, waitsFor } from "./make-status";
import { MODES, modesOf, type Shown, WELCOME } from "./make-stage";
import "./make-stage";
import { MadeResults, TEXTURE } from "./made-results";
import { MakePreviews } from "./make-previews";
import "./material-bar";
import type { Material, Method, Picture, Recipe, ToPage, Variant } from "./messages";
import "./picture-list";
import type { Patch, Point } from "./picture-view";
import { isFull, lacking, picturesOf, toggled, tooMany, withExemplar, withMethod } from "./recipe-edits";
import { RequestError } from "./server";
import { screenPixels } from "./sizes";
import type { Payload, Studio } from "./studio";
import { Undo } from "./undo";
import { blendOf, type Cell, type Kind, newSheet, pictureOf, progressOf } from "./variants";

@customElement("make-view")
export class MakeView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @state() private undo = new Undo<Recipe | null>(null);
  @state() private mode: Shown = "single";
  @state() private kind: Kind = "seeds";
  /** the export that is shown of a result */
  @state() private file = "";
  @state() private isCorrecting = false;
  @state() private outline: Point[] = [];
  @state() private patch: Patch | null = null;
  @query("correct-panel") private panel!: CorrectPanel;
  private results!: MadeResults;
  private previews!: MakePreviews;
  private other!: Comparison;
  private stop: (() => void) | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.results ??= new MadeResults(this.studio, () => this.requestUpdate());
    this.other ??= new Comparison(this.studio);
    this.previews ??= new MakePreviews(this.studio, () => screenPixels(this.querySelector(".stage")), () => this.requestUpdate());
    this.stop = this.studio.listen((message, payload) => this.receive(message, payload));
    this.studio.addEventListener("change", () => this.requestUpdate());
    this.studio.addEventListener("opened", () => this.open(this.studio.project.material));
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.stop?.();
  }

  private get recipe(): Recipe | null {
    return this.undo.now;
  }

  private get method(): Method {
    const { methods } = this.studio.begin;
    return methods.find((one) => one.flow === this.recipe?.flow) ?? methods[0];
  }

  private get lacking(): string { return lacking(this.recipe, this.method); }

  /** The results of this material, as they are now. */
  private get made(): Variant[] {
    const { project, jobs } = this.studio;
    return (project.material?.variants ?? []).map((one) => ({ ...one, job: jobs.get(one.job.id) ?? one.job }));
  }

  private get exemplarId(): string {
    return picturesOf(this.recipe)[0] ?? "";
  }

  // -- the material that is open

  /** Show a material as it was left, or none. */
  private open(material: Material | null): void {
    const draft = material?.draft ?? null;
    const isOurs = this.studio.begin.methods.some((one) => one.flow === draft?.flow);
    this.undo = new Undo(isOurs ? draft : null);
    this.mode = material && material.mode in MODES ? (material.mode as Shown) : "single";
    if (!(this.mode in this.modes)) this.mode = "single";
    this.previews.stop();
    this.results.restore(material?.variants ?? [], material?.shown ?? "");
    this.refresh();
    this.file = material?.file ?? "";
    if (this.file) this.load();
  }

  /** Begin a material of its own where the one that is open has results of another picture. */
  private start(recipe: Recipe): void {
    const { project } = this.studio;
    const isOther = picturesOf(recipe)[0] !== this.exemplarId;
    if (this.recipe && (!isOther || !project.material?.variants.length)) this.edit(recipe);
    else this.begin(recipe);
  }

  private begin(recipe: Recipe): void {
    this.studio.project.begin(recipe);
    this.undo = new Undo<Recipe | null>(recipe);
    this.results.restore([], "");
    this.refresh();
  }

  /** Go back to an earlier result, with the recipe that has made it. */
  private goBack(variant: Variant): void {
    const recipe = this.results.open(this.studio.project.material!.variants, variant);
    if (this.mode === "variants") this.mode = "single";
    this.undo.set(recipe);
    this.refresh();
  }

  private async compare(job: string): Promise<void> {
    this.mode = (await this.other.choose(job, TEXTURE)) ? "compare" : "single";
    this.requestUpdate();
  }

  // -- what the user does

  /** Take a picture that was clicked or dropped: as the exemplar, or as one of several. */
  private choose(picture: Picture, isDropped = false): void {
    const { recipe, method } = this;
    if (!recipe || !method.several) this.start(withExemplar(recipe, picture, this.studio.begin.methods));
    else if (isDropped && picturesOf(recipe).includes(picture.id)) return;
    else if (isFull(recipe, method) && !picturesOf(recipe).includes(picture.id)) this.studio.problem(new RequestError(tooMany(picture, method)));
    else this.edit(toggled(recipe, method, picture.id));
  }

  /** Go on with a variant: another recipe, or a result. */
  private take({ recipe, result }: Cell): void {
    if (result) this.goBack(result);
    else {
      this.mode = "single";
      this.undo.set(recipe);
      this.refresh();
    }
  }

  /** Begin a material that leads from one result to another. */
  private blend(results: Variant[]): void {
    this.studio.know(results.map((one) => pictureOf(one, this.method)));
    this.mode = "single";
    this.begin(blendOf(results));
  }

  private vary(kind: Kind): void {
    this.kind = kind;
    this.refresh();
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
    const parent = this.results.id;
    const job = await this.studio.make(recipe, parent);
    if (!job) return;
    this.results.correct(job, this.outline);
    this.isCorrecting = false;
    this.outline = [];
    this.requestUpdate();
  }

  /** Show what the recipe gives now. */
  private refresh(): void {
    const { recipe, previews, results } = this;
    if (recipe?.flow !== this.results.job?.recipe.flow) this.file = "";
    previews.forget(recipe?.flow);
    results.forget();
    this.endCorrection();
    if (this.other.job) this.mode = "single";
    this.other.end();
    if (this.mode !== "variants") results.recall(recipe);
    this.requestUpdate();
    if (!recipe) return;
    this.studio.project.edit({ draft: recipe, shown: results.id, mode: this.mode, file: this.file });
    if (this.lacking) previews.stop();
    else if (this.mode === "variants") previews.askForSheet(newSheet(this.kind, recipe, this.studio.begin.methods, this.made));
    else if (results.job?.state === "done") {
      previews.hold();
      this.load();
    } else previews.ask(recipe);
    void previews.showExemplar(this.exemplarId);
  }

  private chooseMode(mode: Shown): void {
    const wasSheet = this.mode === "variants";
    this.mode = mode;
    if (mode === "variants" || wasSheet) this.refresh();
    else this.studio.project.edit({ mode });
    if (mode !== "compare") this.other.end();
  }

  private chooseFile(file: string): void {
    this.studio.project.edit({ file: (this.file = file) });
    this.load();
  }

  private async finish(): Promise<void> {
    const recipe = this.recipe!;
    const job = await this.studio.make(recipe);
    if (!job) return;
    this.previews.hold();
    this.results.begin(recipe, job);
    if (this.previews.sheet) [this.previews.sheet, this.mode] = [null, "single"];
    this.requestUpdate();
  }

  private correct(): void {
    [this.mode, this.isCorrecting] = ["single", true];
    if (this.file) this.chooseFile("");
  }

  // -- what the server says

  private receive(message: ToPage, payload: Payload): void {
    this.results.receive(message, payload);
    this.previews.receive(message, payload);
    if (message.kind === "job_changed" && message.job.id === this.results.id) this.load();
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
        <material-bar .studio=${this.studio}></material-bar>
        ${this.recipe ? this.stage() : WELCOME}
        <material-results .studio=${this.studio} .shown=${this.results.id} .against=${this.other.job} ?hidden=${this.isCorrecting}
          @result=${(event: CustomEvent<Variant>) => this.goBack(event.detail)}
          @against=${(event: CustomEvent<string>) => this.compare(event.detail)}></material-results>
      </section>
      <aside class="right" aria-label="Settings">${this.recipe ? this.settings(this.recipe) : nothing}</aside>
    `;
  }

  private get modes(): Partial<Record<Shown, string>> {
    return modesOf(this.method);
  }

  private stage(): TemplateResult {
    const { undo, results, previews } = this;
    const history = { canUndo: undo.canUndo || results.runs.canUndo, canRedo: undo.canRedo || results.runs.canRedo };
    return html`<make-stage .studio=${this.studio} .recipe=${this.recipe} .method=${this.method} .results=${results} .history=${history}
      .mode=${this.mode} .modes=${this.modes} .file=${this.shownFile} .sheet=${previews.sheet} .other=${this.other.picture}
      .preview=${previews.picture} .previewScale=${previews.scale} .exemplar=${previews.exemplar} .done=${previews.done}
      .status=${this.status()} .waits=${previews.problem || waitsFor(this.lacking, this.results)}
      .isCorrecting=${this.isCorrecting} .outline=${this.outline} .patch=${this.patch}
      @mode=${(event: CustomEvent<Shown>) => this.chooseMode(event.detail)}
      @step=${(event: CustomEvent<"undo" | "redo">) => this.step(event.detail)}
      @file=${(event: CustomEvent<string>) => this.chooseFile(event.detail)}
      @vary=${(event: CustomEvent<Kind>) => this.vary(event.detail)}
      @take=${(event: CustomEvent<Cell>) => this.take(event.detail)}
      @blend=${(event: CustomEvent<Variant[]>) => this.blend(event.detail)}
      @lasso=${(event: CustomEvent<Point[]>) => {
        this.outline = event.detail;
        void this.panel.begin(event.detail);
      }}></make-stage>`;
  }

  private status(): string | TemplateResult {
    const { problem, done, picture, scale, isRefined, sheet } = this.previews;
    if (problem) return failure(problem, () => this.previews.again());
    if (sheet) return progressOf(sheet);
    if (this.other.job) return "Left of the line is the result that it is compared with";
    return statusOf(this.results, this.lacking, done < 1, picture ? scale : 0, isRefined);
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
