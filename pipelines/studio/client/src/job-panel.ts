// A run at full size: how far it is, and what it has made.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property } from "lit/decorators.js";
import { Element } from "./element";
import type { Job } from "./messages";
import { cancel, fileAddress } from "./server";
import type { Studio } from "./studio";

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
      ${["failed", "cancelled"].includes(job.state) ? html`<p class="hint">${job.text}</p>` : nothing}
      ${job.files.length
        ? html`<ul class="files" aria-label="Downloads">
            ${job.files.map((file) => html`<li><a href=${fileAddress(job.id, file)} download=${downloadName(job, file)}>${shown(file)}</a></li>`)}
          </ul>`
        : nothing}
    </section>`;
  }
}

const shown = (file: string): string => (file.endsWith("/") ? `${file.slice(0, -1)}.zip` : file);
const downloadName = (job: Job, file: string): string => `${job.name}_${shown(file)}`;
export const seconds = (time: number): string =>
  time < 90 ? `${time.toFixed(time < 10 ? 1 : 0)} s` : `${Math.round(time / 60)} min`;
