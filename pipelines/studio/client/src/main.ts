// The frame of the page: views as tabs, dark and light, messages.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, query, state } from "lit/decorators.js";
import { Element } from "./element";
import { isTyping } from "./fields";
import "./inspect-view";
import type { InspectView } from "./inspect-view";
import type { MakeView } from "./make-view";
import "./make-view";
import "./materials-view";
import type { Described } from "./messages";
import { PictureList } from "./picture-list";
import type { Project } from "./project";
import "./recipe-dialog";
import type { RecipeDialog } from "./recipe-dialog";
import "./runs-view";
import { project, RequestError, start } from "./server";
import { Studio } from "./studio";

const VIEWS = { materials: "Materials", make: "Make", runs: "Runs" } as const;
/** `inspect` lies over that from which something is looked at */
type View = keyof typeof VIEWS | "inspect";
const MESSAGE_TIME = 12_000; // ms

@customElement("texloom-studio")
export class StudioPage extends Element {
  @state() private studio: Studio | null = null;
  @state() private view: View = "make";
  private tab: keyof typeof VIEWS = "make";
  @state() private problem = "";
  @state() private failure = "";
  @query("recipe-dialog") private dialog!: RecipeDialog;
  private hiding = 0;

  constructor() {
    super();
    document.documentElement.dataset.theme = localStorage.getItem("theme") ?? preferredTheme();
    this.begin();
    window.addEventListener("dragover", (event) => event.preventDefault()); // else the browser leaves the page
    window.addEventListener("drop", (event) => void this.drop(event));
  }

  private async begin(): Promise<void> {
    try {
      const [begin, begun] = await Promise.all([start(), project()]);
      this.studio = new Studio(begin, begun);
    } catch (error) {
      this.failure = error instanceof RequestError ? error.message : String(error);
      return;
    }
    this.studio.addEventListener("change", () => this.requestUpdate());
    this.studio.addEventListener("problem", (event) => this.show((event as CustomEvent<string>).detail));
    this.studio.addEventListener("described", (event) => this.dialog.show((event as CustomEvent<Described>).detail));
    await this.comeBack(this.studio.project);
  }

  /** Show what was shown when the page, or the studio, was left. */
  private async comeBack({ place, state }: Project): Promise<void> {
    this.go(place.view in VIEWS ? (place.view as keyof typeof VIEWS) : state.materials ? "materials" : "make");
    await this.updateComplete;
    if (place.material) await this.studio!.project.open(place.material);
  }

  private go(view: keyof typeof VIEWS): void {
    [this.view, this.tab] = [view, view];
    this.studio!.project.look(view);
  }

  /** Open a material where it can be worked at, or none, to begin a new one. */
  private async open(id: string): Promise<void> {
    const { project: opened, begin } = this.studio!;
    if (!id) opened.close();
    else if (!(await opened.open(id))) return;
    const { draft, variants = [] } = opened.material ?? {};
    const done = [...variants].reverse().find(({ job }) => job.state === "done");
    if (!draft || begin.methods.some(({ flow }) => flow === draft.flow) || !done) this.go("make");
    else this.inspect(`job:${done.job.id}`);
  }

  /** Undo and redo in the view that is open. */
  protected override onWindowKey(event: KeyboardEvent): void {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || isTyping(event)) return;
    event.preventDefault();
    const buttons = this.querySelectorAll<HTMLButtonElement>(`[data-step="${event.shiftKey ? "redo" : "undo"}"]`);
    [...buttons].find((one) => one.checkVisibility())?.click();
  }

  /** Take files that are dropped anywhere: into the view that is open, or the one that can use them. */
  private async drop(event: DragEvent): Promise<void> {
    event.preventDefault();
    const data = event.dataTransfer;
    if (!this.studio || !data?.files.length) return;
    const mesh = [...data.files].find((file) => isMesh(file, this.studio!.begin.mesh_suffixes));
    if (mesh) {
      this.go("make");
      this.querySelector<MakeView>("make-view")!.open("mesh");
      await this.studio.takeMesh(mesh); // the layer, which is shown by then, takes it
      return;
    }
    const dropped = PictureList.filesIn(data); // before anything is awaited
    const shown = () => [...this.querySelectorAll<PictureList>("picture-list")].find((one) => one.checkVisibility());
    if (!shown()) this.go("make");
    await this.updateComplete;
    await shown()!.receive(...(await dropped));
  }

  private show(problem: string): void {
    this.problem = problem;
    clearTimeout(this.hiding);
    this.hiding = window.setTimeout(() => (this.problem = ""), MESSAGE_TIME);
  }

  /** Look at an EXR in the view for that. */
  private inspect(item: string): void {
    this.view = "inspect";
    void this.querySelector<InspectView>("inspect-view")!.open(item);
  }

  override render(): TemplateResult {
    const studio = this.studio;
    if (!studio) return html`<main class="waiting" role="status">${this.failure || "Loading pictures …"}</main>`;
    return html`
      <header>
        <h1>texloom <span>studio</span></h1>
        <nav role="tablist" aria-label="Views">
          ${(Object.keys(VIEWS) as (keyof typeof VIEWS)[]).map(
            (view) => html`<button
              role="tab"
              aria-selected=${this.tab === view}
              @click=${() => this.go(view)}
            >${VIEWS[view]}</button>`,
          )}
        </nav>
        <span class="folder" title=${studio.begin.folder}>${studio.begin.folder}</span>
        <button class="quiet" aria-label="Switch between dark and light" title="Dark or light" @click=${switchTheme}>◐</button>
      </header>
      <main>
        <materials-view
          .studio=${studio}
          .isShown=${this.view === "materials"}
          ?hidden=${this.view !== "materials"}
          @open=${(event: CustomEvent<string>) => this.open(event.detail)}
        ></materials-view>
        <make-view
          .studio=${studio}
          ?hidden=${this.view !== "make"}
          @inspect=${(event: CustomEvent<string>) => this.inspect(event.detail)}
        ></make-view>
        <inspect-view .studio=${studio} ?hidden=${this.view !== "inspect"} @close=${() => this.go(this.tab)}></inspect-view>
        <runs-view
          .studio=${studio}
          .isShown=${this.view === "runs"}
          ?hidden=${this.view !== "runs"}
          @inspect=${(event: CustomEvent<string>) => this.inspect(event.detail)}
        ></runs-view>
      </main>
      <recipe-dialog></recipe-dialog>
      <div class="messages" role="alert">
        ${studio.isConnected ? nothing : html`<p>Connecting to the studio …</p>`}
        ${this.problem
          ? html`<p>${this.problem}<button class="quiet" aria-label="Dismiss" @click=${() => (this.problem = "")}>✕</button></p>`
          : nothing}
      </div>
    `;
  }
}

const isMesh = (file: File, suffixes: string[]): boolean => suffixes.some((one) => file.name.toLowerCase().endsWith(one));

function preferredTheme(): string {
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

function switchTheme(): void {
  const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = theme;
  localStorage.setItem("theme", theme);
  window.dispatchEvent(new Event("resize"));
}

