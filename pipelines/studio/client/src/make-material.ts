// The material that Make shows: its recipe, its results and previews, and how they are looked at.
import { Comparison } from "./comparison";
import { statusOf } from "./make-status";
import { MadeResults, TEXTURE } from "./made-results";
import { MakePreviews } from "./make-previews";
import { FIRST_STATE, type MakeState, MODES, modesOf, type Shown, UNCORRECTED } from "./make-modes";
import { hasPreview, isHeld, type LayerName, undrawn } from "./layers";
import type { Job, Material, Method, Picture, Recipe, ToPage, Variant } from "./messages";
import { isFull, lacking, picturesOf, toggled, tooMany, withExemplar, withMethod } from "./recipe-edits";
import { RequestError } from "./server";
import type { Payload, Studio } from "./studio";
import { Undo } from "./undo";
import { blendOf, type Cell, type Kind, newSheet, pictureOf, progressOf } from "./variants";

export class MakeMaterial {
  state: MakeState = { ...FIRST_STATE };
  readonly results: MadeResults;
  readonly previews: MakePreviews;
  readonly other: Comparison;
  /** another number where what is drawn is of another material */
  opened = 0;
  private undo = new Undo<Recipe | null>(null);

  /** ``largest``: px of the screen that there are for a preview */
  constructor(private readonly studio: Studio, largest: () => number, private readonly changed: () => void) {
    this.results = new MadeResults(studio, changed);
    this.other = new Comparison(studio);
    this.previews = new MakePreviews(studio, largest, changed);
    studio.listen((message, payload) => this.receive(message, payload));
    studio.addEventListener("opened", () => this.open(studio.project.material));
  }

  get recipe(): Recipe | null {
    return this.undo.now;
  }

  get method(): Method {
    const { methods } = this.studio.begin;
    return methods.find((one) => one.flow === this.recipe?.flow) ?? methods[0];
  }

  get modes(): Partial<Record<Shown, string>> {
    return modesOf(this.method);
  }

  get lacking(): string {
    return lacking(this.recipe, this.method);
  }

  get history(): { canUndo: boolean; canRedo: boolean } {
    const { undo, results: { runs } } = this;
    return { canUndo: undo.canUndo || runs.canUndo, canRedo: undo.canRedo || runs.canRedo };
  }

  /** What a person is told of it; a problem is one of the previews'. */
  get status(): string {
    const { done, picture, scale, isRefined, sheet } = this.previews;
    if (sheet) return progressOf(sheet);
    if (this.other.job) return "Left of the line is the result that it is compared with";
    return statusOf(this.results, this.lacking, done < 1, picture ? scale : 0, isRefined, hasPreview(this.method));
  }

  /** The export that is shown of a result. */
  get shownFile(): string {
    const files = this.results.job?.files ?? [];
    const views = this.method.views.filter((one) => !files.length || files.includes(one.file));
    return (views.find((one) => one.file === this.state.file) ?? views[0])?.file ?? TEXTURE;
  }

  /** The results of this material, as they are now. */
  private get made(): Variant[] {
    return (this.studio.project.material?.variants ?? []).map((one) => ({ ...one, job: this.studio.jobs.get(one.job.id) ?? one.job }));
  }

  private get exemplarId(): string {
    return picturesOf(this.recipe)[0] ?? "";
  }

  /** Look at it in another way. */
  see(change: Partial<MakeState>): void {
    this.state = { ...this.state, ...change };
    if (!(this.state.mode in this.modes)) this.state.mode = "single";
    this.changed();
  }

  // -- the material that is open

  /** Show a material as it was left, or none. */
  private open(material: Material | null): void {
    this.forgetLayers();
    const draft = material?.draft ?? null;
    const isOurs = this.studio.begin.methods.some((one) => one.flow === draft?.flow);
    this.undo = new Undo(isOurs ? draft : null);
    this.see({ mode: material && material.mode in MODES ? (material.mode as Shown) : "single" });
    this.previews.stop();
    this.results.restore(material?.variants ?? [], material?.shown ?? "");
    this.refresh();
    this.see({ file: material?.file ?? "" });
    if (this.state.file) this.load();
  }

  /** Begin a material of its own where the one that is open has results of another picture. */
  private start(recipe: Recipe): void {
    const { project } = this.studio;
    const isOther = picturesOf(recipe)[0] !== this.exemplarId;
    if (this.recipe && (!isOther || !project.material?.variants.length)) this.edit(recipe);
    else this.begin(recipe);
  }

  private begin(recipe: Recipe): void {
    this.forgetLayers();
    this.studio.project.begin(recipe);
    this.undo = new Undo<Recipe | null>(recipe);
    this.results.restore([], "");
    this.refresh();
  }

  /** Go back to an earlier result, with the recipe that has made it. */
  goBack(variant: Variant): void {
    const recipe = this.results.open(this.studio.project.material!.variants, variant);
    this.see({ layer: "result", ...(this.state.mode === "variants" ? { mode: "single" } : {}) });
    this.undo.set(recipe);
    this.refresh();
  }

  async compare(job: string): Promise<void> {
    this.see({ mode: (await this.other.choose(job, TEXTURE)) ? "compare" : "single" });
  }

  // -- what the user does

  /** Take a picture that was clicked or dropped: as the exemplar, or as one of several. */
  choose(picture: Picture, isDropped = false): void {
    const { recipe, method } = this;
    if (!recipe || !method.several) this.start(withExemplar(recipe, picture, this.studio.begin.methods));
    else if (isDropped && picturesOf(recipe).includes(picture.id)) return;
    else if (isFull(recipe, method) && !picturesOf(recipe).includes(picture.id)) this.studio.problem(new RequestError(tooMany(picture, method)));
    else this.edit(toggled(recipe, method, picture.id));
  }

  /** Go on with a variant: another recipe, or a result. */
  take({ recipe, result }: Cell): void {
    if (result) this.goBack(result);
    else {
      this.see({ mode: "single" });
      this.undo.set(recipe);
      this.refresh();
    }
  }

  /** Begin a material that leads from one result to another. */
  blend(results: Variant[]): void {
    this.studio.know(results.map((one) => pictureOf(one, this.method)));
    this.see({ mode: "single" });
    this.begin(blendOf(results));
  }

  vary(kind: Kind): void {
    this.see({ kind });
    this.refresh();
  }

  edit(change: Partial<Recipe>): void {
    let recipe = { ...this.recipe, ...change } as Recipe;
    if (recipe.flow !== this.recipe?.flow && this.recipe) {
      recipe = withMethod(recipe, this.studio.begin.methods.find((one) => one.flow === recipe.flow)!);
    }
    this.undo.set(recipe);
    this.see({});
    this.refresh();
  }

  step(direction: "undo" | "redo"): void {
    const { runs } = this.results;
    if (direction === "undo" ? runs.canUndo : runs.canRedo) {
      runs[direction]();
      this.see(UNCORRECTED);
      this.load();
    } else {
      this.undo[direction]();
      this.refresh();
    }
  }

  chooseMode(mode: Shown): void {
    const wasSheet = this.state.mode === "variants";
    this.see({ mode });
    if (mode === "variants" || wasSheet) this.refresh();
    else this.studio.project.edit({ mode });
    if (mode !== "compare") this.other.end();
  }

  chooseFile(file: string): void {
    this.see({ file });
    this.studio.project.edit({ file });
    this.load();
  }

  async finish(): Promise<Job | undefined> {
    const recipe = this.recipe!;
    const job = await this.studio.make(recipe);
    if (!job) return undefined;
    this.previews.hold();
    this.results.begin(recipe, job);
    if (this.previews.sheet) [this.previews.sheet, this.state.mode] = [null, "single"];
    this.changed();
    return job;
  }

  // -- its layers
  private forgetLayers(): void {
    this.opened += 1;
    this.see({ layer: "result" });
  }

  showLayer(layer: LayerName): void {
    const isStale = this.previews.sheet !== null || (layer === "result" && this.results.job?.state !== "done");
    this.other.end();
    this.see({ mode: "single", layer });
    if (isStale) this.refresh(); // the previews of a layer end its own
    else if (isHeld(layer)) this.previews.hold();
  }

  /** Go on with what is drawn. */
  draw(recipe: Recipe): void {
    this.undo.set(recipe);
    this.refresh();
  }

  /** Go on without it. */
  undraw(): void {
    this.opened += 1;
    this.studio.project.undraw();
    this.draw(undrawn(this.recipe!, this.method, this.studio.begin.methods));
  }

  /** Make what is drawn. */
  async make(recipe: Recipe): Promise<Job | undefined> {
    if (recipe.flow !== this.recipe?.flow) this.see({ file: "" });
    this.undo.set(recipe);
    this.results.forget();
    this.studio.project.edit({ draft: recipe });
    return this.finish();
  }

  correct(): void {
    this.see({ mode: "single", isCorrecting: true });
    if (this.state.file) this.chooseFile("");
  }

  /** Take a version of a spot, or end the correction without one. */
  async accept(recipe: Recipe | null): Promise<void> {
    if (!recipe) return this.see(UNCORRECTED);
    const job = await this.studio.make(recipe, this.results.id);
    if (!job) return;
    this.results.correct(job, this.state.outline);
    this.see({ isCorrecting: false, outline: [] }); // the version is shown in its place until it is made
  }

  // -- what is shown

  /** Load what is shown of a run that is done. */
  private load(): void {
    const { job } = this.results;
    if (job?.state !== "done") return;
    const file = job.recipe.flow === this.recipe?.flow ? this.shownFile : TEXTURE; // a correction has the texture alone
    void this.results.load(job, file).then(() => this.see({ patch: null }));
  }

  /** Show what the recipe gives now. */
  private refresh(): void {
    const { recipe, previews, results } = this;
    if (recipe?.flow !== results.job?.recipe.flow) this.see({ file: "" });
    previews.forget(recipe?.flow);
    results.forget();
    this.see(this.other.job ? { ...UNCORRECTED, mode: "single" } : UNCORRECTED);
    this.other.end();
    const { mode, kind, file, layer } = this.state;
    if (mode !== "variants") results.recall(recipe);
    this.changed();
    if (!recipe) return;
    this.studio.project.edit({ draft: recipe, shown: results.id, mode, file });
    const isDone = results.job?.state === "done";
    if (this.lacking || (!hasPreview(this.method) && !isDone)) previews.stop();
    else if (mode === "variants") previews.askForSheet(newSheet(kind, recipe, this.studio.begin.methods, this.made));
    else if (isDone || isHeld(layer)) {
      previews.hold();
      this.load();
    } else previews.ask(recipe);
    void previews.showExemplar(this.exemplarId);
  }

  private receive(message: ToPage, payload: Payload): void {
    this.results.receive(message, payload);
    this.previews.receive(message, payload);
    if (message.kind === "job_changed" && message.job.id === this.results.id) this.load();
  }
}
