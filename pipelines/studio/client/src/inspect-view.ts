// Inspect: a result's layers at any zoom, and its material under a light.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, query, state } from "lit/decorators.js";
import { Element } from "./element";
import { choice } from "./fields";
import "./material-view";
import type { ExrContents, Job, Recipe } from "./messages";
import type { Drawable, Mode } from "./picture-view";
import type { TiledView } from "./tiled-view";
import "./tiled-view";
import { ENDLESS, type Tiles } from "./tiles";
import { mapAddress } from "./large-pictures";
import { meshOf, picturesOf } from "./recipe-edits";
import { bitmap, fileAddress, layers, pictureAddress, RequestError } from "./server";
import { sides, sizeText } from "./sizes";
import type { Studio } from "./studio";

const MODES = { single: "Layer", repeat: "Repeat", compare: "Compare", endless: "Endless", material: "Material" } as const;
type Shown = keyof typeof MODES;
const canGoOn = ({ recipe }: Job): boolean => recipe.flow === "per_pixel" && (recipe.tileable ?? "off") === "off";
const exemplarOf = (job?: Job): string | undefined => picturesOf(job?.recipe)[0];

/** The EXR of the main result, or any other one. */
const exrOf = ({ files }: Job): string | undefined => ["texture.exr", ...files].find((file) => files.includes(file) && file.endsWith(".exr"));

@customElement("inspect-view")
export class InspectView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @state() private item = "";
  @state() private layers: ExrContents | null = null;
  @state() private name = "";
  @state() private tiles: Tiles | null = null;
  @state() private exemplar: Drawable | null = null;
  @state() private mode: Shown = "single";
  @query("tiled-view") private view!: TiledView;
  @state() private waits = "";
  @state() private isLoading = false;

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  private get job(): Job | undefined {
    return this.studio.jobs.get(this.item.split(":")[1] ?? "");
  }

  /** Open a run as ``job:ID``, or an EXR as ``result:KEY`` or a picture's id. */
  async open(item: string): Promise<void> {
    this.item = item;
    [this.layers, this.tiles, this.exemplar] = [null, null, null];
    const job = this.job;
    const exr = job ? `job:${job.id}:${exrOf(job)}` : item;
    this.mode = job && this.mode === "single" ? "material" : this.job ? this.mode : "single";
    this.waits = "Reading layers …";
    this.layers = (await this.studio.attempt(layers(exr))) ?? null;
    this.waits = "";
    if (this.layers?.layers.length && this.item === item) this.choose(0);
    const source = exemplarOf(job);
    if (source) this.exemplar = (await this.studio.attempt(bitmap(pictureAddress(source, 2048)))) ?? null;
  }

  private choose(layer: number): void {
    const { key, layers } = this.layers!;
    const { name, height, width } = layers[layer];
    this.name = name;
    this.tiles = { key, layer, height, width };
  }

  override render(): TemplateResult {
    const jobs = [...this.studio.jobs.values()].filter((job) => job.state === "done").reverse();
    const files = this.studio.pictures.filter((one) => one.id.toLowerCase().endsWith(".exr"));
    return html`
      <aside class="left" aria-label="Results">
        <h2>Results</h2>
        <ul class="pictures">
          ${jobs.map((job) => this.entry(`job:${job.id}`, job.name, fileAddress(job.id, job.maps.albedo ?? "texture.png")))}
          ${files.map((one) => this.entry(one.id, one.name, pictureAddress(one.id, 128)))}
        </ul>
      </aside>
      <section class="stage" aria-label="Result">${this.item ? this.stage() : nothing}</section>
      <aside class="right" aria-label="Layers">
        ${this.layers
          ? html`<h2>Layers</h2>
              <div class="list">${this.layers.layers.map(({ name }, layer) => html`<button aria-pressed=${name === this.name}
                @click=${() => {
                  if (this.mode === "material") this.mode = "single";
                  this.choose(layer);
                }}>${name}</button>`)}</div>
              <details><summary>Sizes, channels, provenance</summary><pre tabindex="0">${this.layers.about}</pre></details>`
          : html`<p class="hint" role="status">${this.waits}</p>`}
      </aside>
    `;
  }

  private entry(item: string, name: string, address: string): TemplateResult {
    return html`<li><button aria-pressed=${item === this.item} title=${name} @click=${() => this.open(item)}>
      <img src=${address} alt="" loading="lazy" /><span>${name}</span></button></li>`;
  }

  private stage(): TemplateResult {
    const job = this.job;
    const has: Record<Shown, boolean> = {
      single: true, repeat: true, compare: exemplarOf(job) !== undefined, endless: job !== undefined && canGoOn(job), material: job !== undefined,
    };
    const names = Object.fromEntries(Object.entries(MODES).filter(([mode]) => has[mode as Shown])) as Record<Shown, string>;
    return html`
      <div class="bar">
        ${choice("How to look at it", names, this.mode, (mode) => (this.mode = mode))}
        ${this.mode === "endless" && job ? html`<button class="quiet" @click=${() => this.studio.show(this.inView(job))}>Show as YAML</button>` : nothing}
        <span class="state" role="status">${this.status(job)}</span>
        <button title="To where it was opened" @click=${() => this.tell("close", null)}>Back</button>
      </div>
      ${this.mode === "material" && job
        ? html`<material-view .studio=${this.studio} .maps=${this.mapsOf(job)}
            .mesh=${meshOf(job.recipe)} .side=${job.recipe.size ? sides(job.recipe.size)[0] : 1024}></material-view>`
        : html`<tiled-view .tiles=${this.mode === "endless" ? this.endless(job!) : this.tiles} .exemplar=${this.exemplar}
              .mode=${this.mode === "endless" ? "single" : (this.mode as Mode)} label=${this.mode === "endless" ? "Endless texture" : `Layer ${this.name}`}
              @loading=${(event: CustomEvent<boolean>) => (this.isLoading = event.detail)}
              @problem=${(event: CustomEvent<string>) => this.studio.problem(new RequestError(event.detail))}></tiled-view>
            ${this.isLoading ? html`<progress class="line" aria-label="Loading tiles"></progress>` : nothing}`}
    `;
  }

  private status(job?: Job): string {
    if (this.mode === "endless") return "Windows are made as they come into view";
    if (this.tiles && this.mode !== "material") return `${this.name}, ${this.tiles.height} × ${this.tiles.width} px`;
    return job?.name ?? "";
  }

  private windows: Tiles = { key: "", layer: 0, height: ENDLESS, width: ENDLESS };

  /** The texture of a run without end; the same object for the same run. */
  private endless({ id }: Job): Tiles {
    if (this.windows.endless !== id) this.windows = { ...this.windows, endless: id };
    return this.windows;
  }

  /** The recipe of what is in view of an endless texture. */
  private inView({ recipe }: Job): Recipe {
    const { top, left, height, width } = this.view.window;
    return { ...recipe, size: sizeText([height, width]), params: { ...recipe.params, "texture.origin": [top - ENDLESS / 2, left - ENDLESS / 2] } };
  }

  private known: { job: string; maps: Record<string, string> } = { job: "", maps: {} };

  /** The addresses of a run's maps; the same object for the same run, so that nothing is loaded twice. */
  private mapsOf(job: Job): Record<string, string> {
    if (this.known.job !== job.id) {
      const entries = Object.entries(job.maps).map(([role, file]) => [role, mapAddress(job, file)]);
      this.known = { job: job.id, maps: Object.fromEntries(entries) as Record<string, string> };
    }
    return this.known.maps;
  }
}
