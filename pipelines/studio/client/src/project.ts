// The project: which material is open, and that all changes of it reach the server, in their order.
import type { Drawing, Material, MaterialRequest, Picture, ProjectState, Recipe, ToPage, Variant } from "./messages";
import { createMaterial, editMaterial, lookAt, NoAnswerError, openMaterial, RequestError } from "./server";

const PAUSE = 300; // ms until a change is sent, so that a slider sends one
const AGAIN = 2000; // ms until what could not be sent is sent again
const PLACE = "texloom place"; // of this tab
const MOST_DRAWN = 700_000; // characters of what is drawn; the server refuses more than a MiB
const UNDRAWN: Drawing = { picture: "", collage: null, lattice: null, mesh: null, paint: null, surfaces: null };

/** What of the studio a project needs. */
interface Host extends EventTarget {
  know(pictures: Picture[]): void;
  knowRuns(variants: Variant[]): void;
  changed(): void;
  problem(error: unknown): void;
}

/** Tells the studio `opened` where another material is to be shown, or none. */
export class Project {
  material: Material | null = null;
  /** the id of the material that is open, as soon as the server has given it one */
  private target = { id: "" };
  /** whether there is one, or one is being begun */
  isOpen = false;
  /** what is drawn on the layers of the material that is open */
  drawing = UNDRAWN;
  private waiting: MaterialRequest = {};
  private timer = 0;
  private last: Promise<unknown> = Promise.resolve();

  constructor(readonly state: ProjectState, private readonly host: Host) {
    window.addEventListener("pagehide", () => this.send());
  }

  /** Where this tab was, or else where the project was left. */
  get place(): { view: string; material: string } {
    const own = sessionStorage.getItem(PLACE);
    return own ? JSON.parse(own) : this.state.view;
  }

  /** Remember which view is shown. */
  look(view: string): void {
    this.state.view = { view, material: this.target.id };
    sessionStorage.setItem(PLACE, JSON.stringify(this.state.view));
    void lookAt(this.state.view).catch(() => undefined); // no more than where one was
  }

  /** Open a material; whether that was possible. */
  async open(id: string): Promise<boolean> {
    this.send();
    await this.last;
    try {
      const { material, pictures, missing } = await openMaterial(id);
      this.host.know(pictures);
      this.host.knowRuns(material.variants);
      this.show(material);
      if (missing.length) this.host.problem(new RequestError(missing.join("; ")));
      return true;
    } catch (error) {
      this.host.problem(error);
      return false;
    }
  }

  /** Open none, to begin a new one. */
  close(): void {
    this.send();
    this.show(null);
  }

  private show(material: Material | null): void {
    [this.material, this.target, this.isOpen] = [material, { id: material?.id ?? "" }, material !== null];
    this.drawing = material?.drawing ?? UNDRAWN;
    this.look(this.state.view.view);
    this.host.dispatchEvent(new Event("opened"));
    this.host.changed();
  }

  /** Begin a material with a recipe. */
  begin(recipe: Recipe): void {
    this.send();
    const target = { id: "" };
    [this.material, this.target, this.isOpen, this.drawing] = [null, target, true, UNDRAWN];
    this.enqueue(async () => {
      const made = await createMaterial(recipe);
      target.id = made.id;
      if (this.target !== target) return;
      this.material = { ...made, ...(this.waiting as Partial<Material>) };
      this.look(this.state.view.view);
      this.host.changed();
    });
  }

  /** Change the material that is open. */
  edit(change: MaterialRequest): void {
    if (!this.isOpen) return;
    this.waiting = { ...this.waiting, ...change };
    if (this.material) this.material = { ...this.material, ...(change as Partial<Material>) };
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.send(), PAUSE);
  }

  /** Keep what is drawn on layers over a picture; nothing is left of what was drawn over another one. */
  draw(picture: string, change: Partial<Drawing>): void {
    this.drawing = { ...(this.drawing.picture === picture ? this.drawing : UNDRAWN), ...change, picture };
    if (JSON.stringify(this.drawing).length < MOST_DRAWN) this.edit({ drawing: this.drawing });
    else this.host.problem(new RequestError("So much is drawn that the project does not keep the last of it; it is there until the page is closed"));
  }

  /** Forget what is drawn. */
  undraw(): void {
    this.drawing = UNDRAWN;
    this.edit({ drawing: UNDRAWN });
  }

  /** The id of the material that is open, when it has one and the server has all changes. */
  async ready(): Promise<string> {
    this.send();
    await this.last;
    return this.target.id;
  }

  /** Know a run that was begun here as a result of the material that is open. */
  add(variant: Variant): void {
    if (!this.material || this.material.variants.some(({ job }) => job.id === variant.job.id)) return;
    this.material = { ...this.material, variants: [...this.material.variants, variant], shown: variant.job.id };
    this.host.changed();
  }

  receive(message: ToPage): void {
    if (message.kind === "project_saved") this.state.problem = message.problem;
    else if (message.kind === "material_changed" && message.id === this.target.id) void this.refresh(this.target);
    if (message.kind === "project_saved") this.host.changed();
  }

  /** Take what another page may have changed: name, tags and results; the settings of this page stay. */
  private async refresh(target: { id: string }): Promise<void> {
    await this.last;
    const { material } = await openMaterial(target.id).catch(() => ({ material: null }));
    if (!material || this.target !== target || !this.material) return;
    this.host.knowRuns(material.variants);
    const { name, is_named, tags, is_favourite, is_deleted, variants } = material;
    const changes = this.waiting as Partial<Material>; // of this page, which the server does not have yet
    this.material = { ...this.material, name, is_named, tags, is_favourite, is_deleted, variants, ...changes };
    this.host.changed();
  }

  private send(): void {
    clearTimeout(this.timer);
    const { target, waiting } = this;
    if (!Object.keys(waiting).length) return;
    this.waiting = {};
    this.enqueue(async () => {
      if (!target.id) return; // it could not be begun, which was told
      try {
        await editMaterial(target.id, waiting);
      } catch (error) {
        if (!(error instanceof NoAnswerError)) void this.refresh(target); // such as a name that is taken
        throw error;
      }
    });
  }

  /** Do something when all before it is done; as often as it takes until the server answers. */
  private enqueue(work: () => Promise<void>): void {
    const attempt = async (isFirst: boolean): Promise<void> => {
      try {
        await work();
      } catch (error) {
        if (isFirst || !(error instanceof NoAnswerError)) this.host.problem(error);
        if (!(error instanceof NoAnswerError)) return;
        await new Promise((done) => setTimeout(done, AGAIN));
        await attempt(false);
      }
    };
    this.last = this.last.then(() => attempt(true));
  }
}
