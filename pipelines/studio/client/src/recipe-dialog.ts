// A recipe as a flow file and as a command, which give the same bits in a terminal.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import type { Described } from "./messages";
import { copy, save } from "./studio";

const STATES = { cached: "is in the store", run: "would run", wait: "follows the steps before it", refused: "is refused" };

@customElement("recipe-dialog")
export class RecipeDialog extends Element {
  @property({ attribute: false }) described: Described | null = null;
  @state() private said = "";

  show(described: Described): void {
    this.described = described;
    this.said = "";
    void this.updateComplete.then(() => this.querySelector("dialog")!.showModal());
  }

  override render(): TemplateResult {
    const one = this.described;
    return html`<dialog aria-label="Flow file and command" @click=${this.outside}>
      ${one
        ? html`
            <h2>This result as a flow file</h2>
            <pre tabindex="0" class="yaml">${one.yaml}</pre>
            <p class="row">
              <button @click=${() => save(one.yaml, one.file)}>Save ${one.file}</button>
              <button @click=${() => this.copied(one.yaml, "Flow file copied")}>Copy</button>
            </p>
            <details><summary>What a run would do now</summary>
              <ul class="plan">${one.steps.map((step) => html`<li><strong>${step.name}</strong> ${STATES[step.state]}
                ${step.reasons.length ? html`<span class="hint">${step.reasons.join("; ")}</span>` : nothing}</li>`)}</ul>
            </details>
            <h2>As a command</h2>
            <pre tabindex="0" class="command">${one.command}</pre>
            <p class="row">
              <button @click=${() => this.copied(one.command, "Command copied")}>Copy command</button>
              <span class="hint" role="status">${this.said || "Both make the same result, bit for bit."}</span>
              <button class="end" @click=${() => this.querySelector("dialog")!.close()}>Close</button>
            </p>
          `
        : nothing}
    </dialog>`;
  }

  private async copied(text: string, said: string): Promise<void> {
    await copy(text);
    this.said = said;
  }

  private outside(event: MouseEvent): void {
    if (event.target === this.querySelector("dialog")) this.querySelector("dialog")!.close();
  }
}
