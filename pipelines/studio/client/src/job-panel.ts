// A run at full size: how far it is, and what it has made.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import type { Job } from "./messages";
import { aboutFile, inOrder } from "./made-files";
import { words } from "./method-names";
import { again, allAddress, cancel, fileAddress, RequestError, save } from "./server";
import { download, type Studio } from "./studio";

const MANY = 8; // files, from which on they come as one
/** of layouts that are not written as words are */
const NAMES: Record<string, string> = {
  gltf: "glTF", materialx: "MaterialX", ambientcg: "ambientCG", polyhaven: "Poly Haven", textures_com: "Textures.com", freepbr: "FreePBR",
};
const MAPS = "maps/"; // the export that a layout makes

const STATES: Record<Job["state"], string> = {
  waiting: "Waits for the runs before it",
  running: "Running",
  done: "Done",
  failed: "Failed",
  cancelled: "Cancelled",
};

@customElement("job-panel")
export class JobPanel extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ attribute: false }) job!: Job;
  /** the run that writes the maps for a program */
  @state() private written = "";
  @state() private isSaving = false;

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", this.onChange);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    this.studio.removeEventListener("change", this.onChange);
  }

  private async write(select: HTMLSelectElement): Promise<void> {
    const layout = select.value;
    select.value = "";
    this.written = (await this.studio.start({ ...this.job.recipe, layout }, { delivers: this.job.id }))?.id ?? "";
    this.onChange();
  }

  private async save(): Promise<void> {
    this.isSaving = true;
    await this.studio.attempt(save(this.job.id));
    this.isSaving = false;
  }

  private readonly onChange = (): void => {
    const job = this.studio.jobs.get(this.written);
    if (!job || ["waiting", "running"].includes(job.state)) return;
    this.written = "";
    if (job.state === "done") download(fileAddress(job.id, MAPS), `${job.name}_${job.recipe.layout}.zip`);
    else this.studio.problem(new RequestError(job.text));
  };

  override render(): TemplateResult {
    const { job } = this;
    const isOver = !["waiting", "running"].includes(job.state);
    return html`<section class="job ${job.state}" aria-label="Run at full size">
      <p class="row">
        <strong role="status">${STATES[job.state]}${job.state === "done" ? ` in ${seconds(job.seconds)}` : ""}</strong>
        ${isOver ? nothing : html`<button class="end" @click=${() => this.studio.attempt(cancel(job.id))}>Cancel</button>`}
      </p>
      ${job.state === "running"
        ? html`<progress max="1" .value=${job.done} aria-label="Progress of the step ${job.step}"></progress>
            <p class="hint">${[job.step, job.text].filter(Boolean).join(": ")}</p>`
        : nothing}
      ${["failed", "cancelled"].includes(job.state) 
        ? html`<p class="hint">${job.text}</p><p class="row"><button @click=${() => this.studio.attempt(again(job.id))}>Try again</button></p>`
        : nothing}
      ${job.files.length
        ? html`<h2>Export</h2>
            <label class="field"><span>Maps for</span>
              <select aria-label="Download maps for a program" ?disabled=${this.written !== ""}
                @change=${(event: Event) => this.write(event.target as HTMLSelectElement)}>
                <option value="">${this.written ? "Writing …" : "choose …"}</option>
                ${this.studio.begin.layouts.map((one) => html`<option value=${one}>${NAMES[one] ?? words(one)}</option>`)}
              </select></label>
            <ul class="files" aria-label="Downloads">
              ${inOrder(job.files).map((file) => html`<li>
                <a href=${fileAddress(job.id, file)} download=${downloadName(job, file)}>${shown(file)}</a>
                <span class="hint">${aboutFile(file)}</span></li>`)}
            </ul>
            <p class="row">${job.files.length > MANY ? html`<a class="button" href=${allAddress(job.id)} download="${job.name}.zip">All as a zip</a>` : nothing}
              <button ?disabled=${this.isSaving} @click=${() => this.save()}>Save in the folder</button></p>
            ${job.saved ? html`<p class="hint" role="status">Saved in ${job.saved}</p>` : nothing}`
        : nothing}
    </section>`;
  }
}

const shown = (file: string): string => (file.endsWith("/") ? `${file.slice(0, -1)}.zip` : file);
const downloadName = (job: Job, file: string): string => `${job.name}_${shown(file)}`;
export const seconds = (time: number): string =>
  time < 90 ? `${time.toFixed(time < 10 ? 1 : 0)} s` : `${Math.round(time / 60)} min`;
