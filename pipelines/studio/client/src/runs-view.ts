// Runs: what is being computed, what the store holds, and the flows that ship.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import "./job-panel";
import { seconds } from "./job-panel";
import type { FlowEntry, PastRun, PastRuns, PastStep } from "./messages";
import { flows, resultAddress, runs, steps } from "./server";
import type { Studio } from "./studio";

/** Tells `inspect` with a result of the store. */
@customElement("runs-view")
export class RunsView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ type: Boolean }) isShown = false;
  @state() private found: PastRuns | null = null;
  @state() private flows: FlowEntry[] = [];
  @state() private chosen: PastRun | null = null;
  @state() private steps: PastStep[] = [];

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  protected override updated(changed: Map<string, unknown>): void {
    if (changed.has("isShown") && this.isShown) void this.load();
  }

  private async load(): Promise<void> {
    this.found = (await this.studio.attempt(runs())) ?? this.found;
    if (!this.flows.length) this.flows = (await this.studio.attempt(flows())) ?? [];
  }

  private async choose(run: PastRun): Promise<void> {
    this.chosen = run;
    this.steps = [];
    this.steps = (await this.studio.attempt(steps(run.id))) ?? [];
  }

  override render(): TemplateResult {
    const jobs = [...this.studio.jobs.values()].reverse();
    return html`
      <aside class="left" aria-label="Runs of this studio" tabindex="0">
        <h2>Running, or opened</h2>
        ${jobs.length ? nothing : html`<p class="hint">Runs at full size appear here, with their progress.</p>`}
        ${jobs.map((job) => html`<p class="name" title=${job.name}>${job.name}</p>
          <job-panel .studio=${this.studio} .job=${job}></job-panel>`)}
        <h2>Flows</h2>
        <ul class="flows">${this.flows.map((flow) => html`<li title=${flow.about}>${flow.name}</li>`)}</ul>
      </aside>
      <section class="stage" aria-label="Runs in the store">
        <div class="bar"><span class="state start">${this.found ? counted(this.found, this.studio.begin.store) : "Reading the store …"}</span>
          <button @click=${() => this.load()}>Refresh</button></div>
        <ul class="pictures wall">
          ${(this.found?.runs ?? []).map((run) => html`<li><button aria-pressed=${run.id === this.chosen?.id} @click=${() => this.choose(run)}>
            ${run.cover ? html`<img src=${addressOf(run.cover)} alt="" loading="lazy" />` : html`<span class="blank"></span>`}
            <span>${Object.values(run.sources)[0] ?? run.flow}</span>
            <span>${run.flow}, ${run.seeds.length > 1 ? `${run.seeds.length} seeds` : `seed ${run.seeds[0]}`}</span>
          </button></li>`)}
        </ul>
      </section>
      <aside class="right" aria-label="Steps of the run">
        ${this.chosen
          ? html`<h2>${this.chosen.flow}</h2>
              <p class="hint">last run ${new Date(1000 * this.chosen.used).toLocaleString()}</p>
              ${this.steps.map((step) => this.step(step))}`
          : html`<p class="hint">Choose a run to see its steps.</p>`}
      </aside>
    `;
  }

  private step(step: PastStep): TemplateResult {
    const params = Object.entries(step.params).map(([name, value]) => `${name}: ${value}`).join("\n");
    return html`<section class="step">
      <p class="row"><strong>${step.name}</strong><span class="hint end">${step.stage ? seconds(step.seconds) : "removed"}</span></p>
      <p class="hint" title=${params}>${step.stage}</p>
      ${step.pictures.length
        ? html`<button class="thumbs" title="Inspect the layers of ${step.name}" @click=${() => this.tell("inspect", `result:${step.key}`)}>
            ${step.pictures.slice(0, 4).map((name) => html`<img src=${resultAddress(step.key, name)} alt=${name} title=${name} loading="lazy" />`)}
          </button>`
        : nothing}
    </section>`;
  }
}

const addressOf = (cover: string): string => resultAddress(...(cover.split("/") as [string, string]));

function counted({ runs, found, corrections }: PastRuns, store: string): string {
  const all = found === 1 ? "1 run" : `${found} runs`;
  const listed = found > runs.length ? `the last ${runs.length} of ${all}` : all;
  const versions = corrections === 1 ? "1 version of a correction is" : `${corrections} versions of corrections are`;
  return `${listed} in ${store}${corrections ? `; ${versions} with their materials` : ""}`;
}
