// The base of all elements: they render into the page itself, so that one style sheet serves all.
import { LitElement } from "lit";

export class Element extends LitElement {
  protected override createRenderRoot(): HTMLElement {
    return this;
  }

  /** What a key does, wherever in the window it is pressed. */
  protected onWindowKey?(event: KeyboardEvent): void;

  private readonly windowKey = (event: KeyboardEvent): void => this.onWindowKey?.(event);

  override connectedCallback(): void {
    super.connectedCallback();
    if (this.onWindowKey) window.addEventListener("keydown", this.windowKey);
  }

  override disconnectedCallback(): void {
    super.disconnectedCallback();
    window.removeEventListener("keydown", this.windowKey);
  }

  /** Tell those around this element. */
  protected tell<T>(name: string, detail: T): void {
    this.dispatchEvent(new CustomEvent(name, { detail, bubbles: true }));
  }
}
