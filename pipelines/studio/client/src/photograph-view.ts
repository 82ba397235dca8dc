// The layer Surfaces: place patches on a photograph's surfaces, paint areas, and make flat textures, fill holes or cover others.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import type { Draft } from "./drafts";
import { choice, failure, undoButtons } from "./fields";
import { viewed } from "./large-pictures";
import { LayerPreview } from "./layer-preview";
import { MaterialLayer } from "./material-layer";
import type { PhotoProposal, Recipe, ToPage } from "./messages";
import { words } from "./method-names";
import { Photo, photos } from "./photo";
import { PhotoAnswers } from "./photo-answers";
import type { Brush, Edit } from "./photo-canvas";
import "./photo-canvas";
import { changed, cleared, documentOf, EMPTY, type Handle, painted, type PhotoDocument, withPlane, without } from "./photo-document";
import { photoFlow, PURPOSES, type Settings } from "./photo-flows";
import { patchesSide } from "./photo-patches";
import { type Area, AREAS, areasSide, makeSide } from "./photo-sides";
import "./picture-view";
import { screenPixels } from "./sizes";
import type { Payload } from "./studio";

const STEPS = { surface: "Surface", areas: "Areas", make: "Make" } as const;
type Step = keyof typeof STEPS;

@customElement("photograph-view")
export class PhotographView extends MaterialLayer {
  protected readonly layer = "surfaces";
  @state() private photo: Photo | null = null;
  @state() private step: Step = "surface";
  @state() private isCurved = false;
  @state() private hasGrid = true;
  @state() private hasStreamlines = false;
  @state() private handle: Handle | null = null;
  @state() private area: Area = "region";
  @state() private brush: Required<Brush> = { tool: "stroke", erase: false, radius: 24, tolerance: 8, features: "dark" };
  @state() private settings: Settings = { purpose: "flatten", side: 512, tileable: "both", seed: 7, scene: "" };
  @query("canvas.front") private front!: HTMLCanvasElement;
  private preview!: LayerPreview;
  private answers!: PhotoAnswers;
  private live: PhotoDocument | null = null; // while a hand moves

  protected override onChange = (): void => {
    if (!this.studio.isConnected) this.answers.lose();
    this.requestUpdate();
  };

  private ask(): void {
    this.answers.ask();
  }

  private propose(): void {
    this.answers.propose();
    this.requestUpdate();
  }

  private get document(): PhotoDocument {
    return this.live ?? this.photo?.undo.now ?? EMPTY;
  }

  // -- the server

  protected override async open(): Promise<void> {
    const { picture } = this;
    const kept = documentOf(this.kept?.surfaces);
    const known = photos.get(picture.id);
    if (!known || JSON.stringify(known.undo.now) !== JSON.stringify(kept)) {
      const loaded = known?.viewed ?? (await this.studio.attempt(viewed(picture.id, picture)));
      if (!loaded) return;
      photos.set(picture.id, new Photo(picture, loaded, kept, known?.areas));
    }
    if (picture !== this.picture) return;
    this.photo = photos.get(picture.id)!;
    [this.live, this.handle, this.job] = [null, null, ""];
    this.answers.refuse("");
    this.ask();
  }

  override connectedCallback(): void {
    super.connectedCallback();
    const own = this;
    this.answers ??= new PhotoAnswers(this.studio, {
      get shown() { return own.photo; },
      get document() { return own.document; },
      get wantsLines() { return own.hasStreamlines && !own.live; },
      propose: (planes) => this.onProposal(planes),
      follow: (isNew) => isNew && (this.live ? this.preview.follow() : this.preview.ask()),
    });
    const largest = () => screenPixels(this.querySelector("photo-canvas"));
    this.preview ??= new LayerPreview(this.studio, () => this.draft(), largest, () => this.requestUpdate());
  }

  protected override pause(): void {
    this.preview.stop();
  }

  protected override receive(message: ToPage, payload: Payload): void {
    this.preview.receive(message, payload);
    this.answers.receive(message, payload);
    this.requestUpdate();
  }

  private onProposal(planes: PhotoProposal["planes"]): void {
    let { document } = this;
    for (const corners of planes) {
      const [next, name] = withPlane(document, corners);
      document = next;
      this.photo!.patch = name;
    }
    if (planes.length) this.set(document);
    else this.answers.refuse("No plane is evident from the lines of the photograph: add one by hand");
  }

  // -- edits

  private set(document: PhotoDocument): void {
    this.live = null;
    this.photo!.undo.set(document);
    this.keep({ surfaces: this.photo!.recipe });
    if (!document.patches.some((one) => one.name === this.photo!.patch)) this.photo!.patch = document.patches.at(-1)?.name ?? "";
    this.photo!.streamlines = null;
    this.ask();
    this.requestUpdate();
  }

  private onEdit({ document, isFinal }: Edit): void {
    if (isFinal) {
      this.set(document);
    } else {
      this.live = document;
      this.ask();
    }
  }

  private undoOrRedo(direction: "undo" | "redo"): void {
    if (!this.photo) return;
    this.photo.undo[direction]();
    this.keep({ surfaces: this.photo.recipe });
    this.live = null;
    if (!this.document.patches.some((one) => one.name === this.photo!.patch)) this.photo.patch = this.document.patches[0]?.name ?? "";
    this.photo.streamlines = null;
    this.ask();
    this.requestUpdate();
  }

  private select(name: string): void {
    this.photo!.patch = name;
    this.handle = null;
    this.ask();
    this.requestUpdate();
  }

  private addPlane(): void {
    const { height, width } = this.photo!.picture;
    const [top, bottom, left, right] = [0.25 * height, 0.75 * height, 0.25 * width, 0.75 * width];
    const [document, name] = withPlane(this.document, [[top, left], [top, right], [bottom, right], [bottom, left]]);
    this.photo!.patch = name;
    this.set(document);
  }

  // -- results

  protected override async drawn(): Promise<Recipe | undefined> {
    const scene = photos.get(this.settings.scene);
    return this.studio.attempt(photoFlow(this.photo!.recipe, scene?.recipe ?? null, this.settings));
  }

  // -- how it looks

  protected override updated(): void {
    const shown = this.photo?.front;
    if (!this.front || !shown) return;
    [this.front.width, this.front.height] = [shown.width, shown.height];
    this.front.getContext("2d")!.drawImage(shown, 0, 0);
  }

  override render(): TemplateResult {
    const { photo } = this;
    return html`
      <section class="stage" aria-label="Photograph">${photo ? this.stage(photo) : html`<p class="welcome" role="status">Loading the photograph …</p>`}</section>
      <aside class="right" aria-label="Surfaces">${this.cards(photo ? this.side(photo) : nothing)}
        ${this.step === "make" ? this.ending(PURPOSES[this.settings.purpose].label, this.canFinish) : nothing}</aside>
    `;
  }

  private stage(photo: Photo): TemplateResult {
    const { undo } = photo;
    const toggle = (label: string, is: boolean, set: (is: boolean) => void) => html`<label class="row">
      <input type="checkbox" .checked=${is} @change=${(event: Event) => set((event.target as HTMLInputElement).checked)} />${label}</label>`;
    return html`
      <div class="bar">
        ${choice("What to do", STEPS, this.step, (step) => (this.step = step))}
        ${undoButtons(undo, (direction) => this.undoOrRedo(direction))}
        ${toggle("Grid", this.hasGrid, (is) => (this.hasGrid = is))}
        ${toggle("Streamlines", this.hasStreamlines, (is) => {
          this.hasStreamlines = is;
          photo.streamlines = null;
          this.ask();
        })}
        <span class="state" role="status">${this.status(photo)}</span>
      </div>
      <div class="spaces"><photo-canvas label="Photograph ${photo.picture.name}" .picture=${photo.viewed.picture} .tiles=${photo.viewed.tiles} .photo=${photo.picture}
        .document=${this.document} .described=${photo.described} .areas=${new Map(photo.areas)}
        .streamlines=${this.hasStreamlines ? photo.streamlines : null} .patchName=${this.step === "make" ? "" : photo.patch} .isCurved=${this.isCurved}
        .hasGrid=${this.hasGrid} .area=${this.step === "areas" ? this.area : ""} .brush=${this.brush} .handle=${this.handle}
        @edit=${(event: CustomEvent<Edit>) => this.onEdit(event.detail)}
        @select=${(event: CustomEvent<string>) => this.select(event.detail)}
        @handle=${(event: CustomEvent<Handle | null>) => (this.handle = event.detail)}></photo-canvas>
        ${this.step === "make" && this.preview.picture ? html`<picture-view label="Preview" .picture=${this.preview.picture} .isReduced=${!this.preview.isWhole}></picture-view>` : nothing}</div>
    `;
  }

  private status(photo: Photo): string | TemplateResult {
    const { problem, failed, isProposing } = this.answers;
    if (problem) return failed ? failure(problem, failed) : problem;
    if (isProposing) return "Looking for planes …";
    if (!this.document.patches.length) return "Propose planes, or add one";
    const invalid = [...photo.described.values()].find((one) => one.problem);
    if (invalid) return invalid.problem;
    if (this.step === "make") return this.preview.status || "Made at full size when it is finished";
    return this.step === "areas" ? `Paint: ${AREAS[this.area].toLowerCase()}` : "Cells of the grid are squares in the texture";
  }

  private side(photo: Photo): TemplateResult {
    if (this.step === "make") {
      const scenes = [...photos.values()].filter((one) => one !== photo && one.undo.now.areas.hole);
      return makeSide(this.settings, scenes, (settings) => {
        this.settings = settings;
        this.preview.ask();
      });
    }
    return html`${this.step === "areas" ? this.areas(photo) : this.surfaceSide(photo)}
      <figure class="front" ?hidden=${!photo.front || !photo.patch}>
        <figcaption>${photo.patch && words(photo.patch)} from the front</figcaption>
        <canvas class="front" role="img" aria-label="The patch as seen from the front"></canvas>
      </figure>
      ${this.preview.picture ? html`<figure class="front">
        <figcaption>${PURPOSES[this.settings.purpose].short}: what is made of it</figcaption>${this.preview.picture}</figure>` : nothing}`;
  }

  private areas({ undo }: Photo): TemplateResult {
    const { area, brush } = this;
    return areasSide(undo.now, area, brush, {
      area: (one) => (this.area = one), brush: (one) => (this.brush = one), clear: () => this.set(cleared(undo.now, area)),
      mark: () => this.set(painted(undo.now, area, { ...brush, points: [] })),
    });
  }

  private surfaceSide(photo: Photo): TemplateResult {
    const { document, handle, isCurved } = this;
    return patchesSide(document, photo, { isProposing: this.answers.isProposing, isCurved, handle }, {
      propose: () => this.propose(), add: () => this.addPlane(), select: (name) => this.select(name),
      points: (is) => ([this.isCurved, this.handle] = [is, null]),
      change: (change) => this.set(changed(document, photo.patch, change)), remove: () => this.set(without(document, photo.patch)),
    });
  }

  private get canFinish(): boolean {
    const { purpose, scene } = this.settings;
    return this.document.patches.length > 0 && (purpose !== "place" || scene !== "");
  }

  /** What of it can be previewed. */
  private async draft(): Promise<Draft | undefined> {
    const { photo, answers: { asked } } = this;
    const isInvalid = !photo || [...photo.described.values()].some(({ problem }) => problem);
    if (isInvalid || !asked.patches.length || !this.canFinish || (this.settings.purpose === "fill" && !asked.areas.hole)) return undefined;
    const recipe = await photoFlow({ ...photo.recipe, ...asked }, photos.get(this.settings.scene)?.recipe ?? null, this.settings).catch(() => undefined);
    return recipe && { recipe, attached: {} };
  }
}
