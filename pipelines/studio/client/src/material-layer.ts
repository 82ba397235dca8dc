// What the layers of a material share: what is drawn on them becomes a result of the same material.
import { html, nothing, type TemplateResult } from "lit";
import { property, state } from "lit/decorators.js";
import { Element } from "./element";
import { card, choice } from "./fields";
import "./job-panel";
import { LAYERS, type LayerName } from "./layers";
import type { Drawing, Job, Picture, Recipe, ToPage } from "./messages";
import type { Drawable } from "./picture-view";
import { isOver, type Payload, type Studio } from "./studio";

const PLACED = { result: "Result", surfaces: "Surfaces" } as const;

/** Tells `layer` with another one, `drawn` with a recipe to go on with, and `inspect` with a result. */
export abstract class MaterialLayer extends Element {
  @property({ attribute: false }) studio!: Studio;
  /** what the material begins with */
  @property({ attribute: false }) picture!: Picture;
  /** as it is without this layer */
  @property({ attribute: false }) recipe!: Recipe;
  /** what is on the stage of the material */
  @property({ attribute: false }) begun: Drawable | null = null;
  /** makes a result of the material */
  @property({ attribute: false }) make!: (recipe: Recipe) => Promise<Job | undefined>;
  /** the run that was started here last, unless something has changed since */
  @state() protected job = "";
  protected abstract readonly layer: LayerName;
  private stop: (() => void) | null = null;

  override connectedCallback(): void {
    super.connectedCallback();
    this.stop = this.studio.listen((message, payload) => this.receive(message, payload));
    this.studio.addEventListener("change", this.onChange);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.stop?.();
    this.studio.removeEventListener("change", this.onChange);
  }

  protected override willUpdate(changed: Map<string, unknown>): void {
    if (changed.has("picture") && (changed.get("picture") as Picture | undefined)?.id !== this.picture.id) void this.open();
  }

  /** What is kept of what was drawn on this picture; none where nothing was. */
  protected get kept(): Drawing | null {
    const { drawing } = this.studio.project;
    return drawing.picture === this.picture.id ? drawing : null;
  }

  /** Keep what is drawn on this layer. */
  protected keep(change: Partial<Drawing>): void {
    if (Object.keys(change).length) this.studio.project.draw(this.picture.id, change);
  }

  /** Begin with another picture. */
  protected abstract open(): Promise<void>;
  /** The recipe of what is drawn; none where that cannot be made, which is told. */
  protected abstract drawn(): Promise<Recipe | undefined>;
  protected receive(_message: ToPage, _payload: Payload): void {}

  protected onChange = (): void => this.requestUpdate();

  protected get run(): Job | undefined {
    return this.studio.jobs.get(this.job);
  }

  /** Let previews rest: the processors are wanted for something else. */
  protected pause(): void {}

  protected async finish(): Promise<void> {
    this.pause();
    const recipe = await this.drawn();
    this.job = (recipe && (await this.make(recipe)))?.id ?? this.job;
  }

  /** Go to another layer. */
  protected async leave(layer: LayerName): Promise<void> {
    this.pause();
    if (layer !== this.layer) this.tell("layer", layer);
  }

  /** The choice of a layer, and what is chosen on this one. */
  protected cards(tools: unknown): TemplateResult {
    const names: Partial<Record<LayerName, string>> = this.layer === "surfaces" ? PLACED : LAYERS;
    const layers = html`<div class="layers">${choice("Layer", names as Record<LayerName, string>, this.layer, (one) => void this.leave(one))}</div>`;
    return html`${card("Draw", "", true, layers)} ${card(names[this.layer]!, "", true, tools)}`;
  }

  /** The buttons that make a result, and the run that does. */
  protected ending(label: string, canFinish = true): TemplateResult {
    const { run } = this;
    return html`
      <button class="primary" ?disabled=${!canFinish || (run && !isOver(run))} @click=${() => this.finish()}>${label}</button>
      <button ?disabled=${!canFinish} @click=${async () => this.studio.show(await this.drawn())}>Show as YAML or command</button>
      ${run ? html`<job-panel .studio=${this.studio} .job=${run}></job-panel>` : nothing}
      ${run?.state === "done" ? html`<button @click=${() => this.tell("inspect", `job:${run.id}`)}>Inspect it</button>` : nothing}`;
  }
}
