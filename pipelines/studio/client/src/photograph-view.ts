// The layer Surfaces: place patches on a photograph's surfaces, paint areas, and make flat textures, fill holes or cover others.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import { surface } from "./bezier";
import type { Draft } from "./drafts";
import { choice, failure, undoButtons } from "./fields";
import { viewed } from "./large-pictures";
import { LayerPreview } from "./layer-preview";
import { MaterialLayer } from "./material-layer";
import type { PatchRecipe, PhotoPatch, PhotoProposal, Recipe, ToPage } from "./messages";
import { words } from "./method-names";
import { Photo, photos, tinted } from "./photo";
import type { Brush, Edit } from "./photo-canvas";
import "./photo-canvas";
import { changed, cleared, documentOf, EMPTY, type Handle, painted, type PhotoDocument, weighted, withPlane, without } from "./photo-document";
import { photoFlow, PURPOSES, type Settings } from "./photo-flows";
import { type Area, AREAS, areasSide, makeSide, slider } from "./photo-sides";
import "./picture-view";
import { screenPixels, sides, sizeText } from "./sizes";
import { canvasOf, type Payload } from "./studio";

const FRONT = 320; // px of the patch as seen from the front
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
  @state() private problem = "";
  /** what to try again, where the server has failed */
  private failed: (() => void) | null = null;
  @state() private isProposing = false;
  @query("canvas.front") private front!: HTMLCanvasElement;
  private preview!: LayerPreview;
  /** of which the server has said, or will say, whether it is valid */
  private asked: PhotoDocument = EMPTY;
  private previewed: PhotoDocument = EMPTY;
  private live: PhotoDocument | null = null; // while a hand moves
  private number = -1;
  private isWaiting = false;
  private isDirty = false;

  protected override onChange = (): void => {
    if (!this.studio.isConnected) this.isWaiting = false;
    this.requestUpdate();
  };

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
    [this.live, this.problem, this.handle, this.job] = [null, "", null, ""];
    this.ask();
  }

  /** Ask what follows from the document; while an answer is awaited, only the newest is asked afterwards. */
  private ask(): void {
    this.isDirty = true;
    if (this.isWaiting || !this.photo) return;
    [this.isDirty, this.isWaiting, this.asked] = [false, true, this.document];
    this.number = this.studio.next();
    const recipe = { ...this.photo.recipe, ...this.asked };
    const streamlines = this.hasStreamlines && !this.live;
    this.studio.send({ kind: "photo", number: this.number, recipe, patch: this.photo.patch, side: FRONT, streamlines });
  }

  private propose(): void {
    if (!this.photo) return;
    [this.isProposing, this.isWaiting] = [true, true];
    this.number = this.studio.next();
    this.studio.send({ kind: "photo", number: this.number, recipe: { photo: this.photo.picture.id }, propose: true });
  }

  override connectedCallback(): void {
    super.connectedCallback();
    const largest = () => screenPixels(this.querySelector("photo-canvas"));
    this.preview ??= new LayerPreview(this.studio, () => this.draft(), largest, () => this.requestUpdate());
  }

  protected override pause(): void {
    this.preview.stop();
  }

  protected override receive(message: ToPage, payload: Payload): void {
    this.preview.receive(message, payload);
    const { photo } = this;
    if (!photo || !("number" in message) || message.number !== this.number) return;
    if (message.kind === "photo_state") {
      this.problem = "";
      this.describe(photo, message.patches);
      if (this.previewed !== this.asked) this.live ? this.preview.follow() : this.preview.ask();
      this.previewed = this.asked;
      this.answered();
    } else if (message.kind === "photo_proposal") {
      this.onProposal(message);
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
      this.problem = message.problem;
      this.isProposing = false;
      this.answered();
    }
    this.requestUpdate();
  }

  private answered(): void {
    this.isWaiting = false;
    if (this.isDirty) this.ask();
  }

  /** While a patch is invalid, the grids of before stay. */
  private describe(photo: Photo, patches: PhotoPatch[]): void {
    const before = photo.described;
    photo.described = new Map(
      patches.map((one) => {
        const old = before.get(one.name);
        return [one.name, one.rows.length || !old ? one : { ...old, problem: one.problem }];
      }),
    );
    if (patches.some((one) => one.problem)) photo.streamlines = null;
  }

  private onProposal({ planes }: PhotoProposal): void {
    [this.isProposing, this.isWaiting] = [false, false];
    let { document } = this;
    for (const corners of planes) {
      const [next, name] = withPlane(document, corners);
      document = next;
      this.photo!.patch = name;
    }
    if (planes.length) this.set(document);
    else [this.failed, this.problem] = [null, "No plane is evident from the lines of the photograph: add one by hand"];
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

  private get patch(): PatchRecipe | undefined {
    return this.document.patches.find((one) => one.name === this.photo?.patch);
  }

  private edit(change: (patch: PatchRecipe) => PatchRecipe): void {
    this.set(changed(this.document, this.photo!.patch, change));
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
    if (this.problem) return this.failed ? failure(this.problem, this.failed) : this.problem;
    if (this.isProposing) return "Looking for planes …";
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
    const { patch } = this;
    return html`
      <p class="row"><button class="half" ?disabled=${this.isProposing} @click=${() => this.propose()}>Propose planes</button>
        <button class="half" @click=${() => this.addPlane()}>Add a plane</button></p>
      <ul class="list" aria-label="Patches">${this.document.patches.map((one) => {
        const problem = photo.described.get(one.name)?.problem;
        return html`<li><button class=${problem ? "bad" : ""} aria-pressed=${one.name === photo.patch} title=${problem || words(one.name)}
          @click=${() => this.select(one.name)}>${words(one.name)}${one.corners ? "" : ", curved"}${problem ? " ⚠" : ""}</button></li>`;
      })}</ul>
      ${patch
        ? html`
            ${choice("Points to drag", { plane: "Corners", curve: "Control points" }, this.isCurved ? "curve" : "plane", (one) => {
              [this.isCurved, this.handle] = [one === "curve", null];
            })}
            <p class="hint">Drag the points. Or choose one with [ and ], and move it with the arrow keys.</p>
            ${this.handle?.kind === "control" ? this.weight(patch, this.handle.row, this.handle.column) : nothing}
            <div class="field"><span>Real size</span><span class="pair">
              ${[1, 0].map((axis) => html`<input type="number" min="0" step="any" placeholder="auto" aria-label=${axis ? "Real width" : "Real height"}
                .value=${patch.size ? String(sides(patch.size)[axis]) : ""} @change=${(event: Event) => this.resize(patch, axis, event)} />`)}</span></div>
            <p class="hint">Width and height in any unit, the same for all patches; without them the perspective decides.</p>
            <button @click=${() => this.set(without(this.document, patch.name))}>Remove ${words(patch.name).toLowerCase()}</button>
          `
        : nothing}
    `;
  }

  private weight(patch: PatchRecipe, row: number, column: number): TemplateResult {
    const weight = surface(patch).weights[row][column];
    return slider("Weight", Math.round(100 * Math.log2(weight)), -300, 300, weight.toFixed(2), (value) =>
      this.edit((one) => weighted(one, row, column, 2 ** (value / 100))),
    );
  }

  private resize(patch: PatchRecipe, axis: number, event: Event): void {
    const value = Number((event.target as HTMLInputElement).value);
    const size = sides(patch.size ?? "1");
    size[axis] = value;
    this.edit(({ size: _, ...others }) => (value > 0 ? { ...others, size: sizeText(size) } : others));
  }

  private get canFinish(): boolean {
    const { purpose, scene } = this.settings;
    return this.document.patches.length > 0 && (purpose !== "place" || scene !== "");
  }

  /** What of it can be previewed. */
  private async draft(): Promise<Draft | undefined> {
    const { photo, asked } = this;
    const isInvalid = !photo || [...photo.described.values()].some(({ problem }) => problem);
    if (isInvalid || !asked.patches.length || !this.canFinish || (this.settings.purpose === "fill" && !asked.areas.hole)) return undefined;
    const recipe = await photoFlow({ ...photo.recipe, ...asked }, photos.get(this.settings.scene)?.recipe ?? null, this.settings).catch(() => undefined);
    return recipe && { recipe, attached: {} };
  }
}
