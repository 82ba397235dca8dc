// The wall: all materials of the project, to be found, opened, named and thrown away.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { repeat } from "lit/directives/repeat.js";
import { Element } from "./element";
import "./material-card";
import "./material-details";
import type { MaterialRequest, ToPage, Wall, WallEntry } from "./messages";
import { duplicateMaterial, editMaterial, wall } from "./server";
import type { Studio } from "./studio";

const PAGE = 60; // materials at a time
const PAUSE = 200; // ms until a search begins
const SORTINGS = { changed: "Last changed", made: "Newest", name: "Name" };
/** What is asked for; the server keeps the same names. */
interface Query {
  search: string;
  tag: string;
  favourites: boolean;
  deleted: boolean;
  sorting: keyof typeof SORTINGS;
}
const ALL: Query = { search: "", tag: "", favourites: false, deleted: false, sorting: "changed" };

/** Tells `open` with the id of a material. */
@customElement("materials-view")
export class MaterialsView extends Element {
  @property({ attribute: false }) studio!: Studio;
  @property({ type: Boolean }) isShown = false;
  @state() private query: Query = ALL;
  @state() private found: Wall | null = null;
  @state() private shown: WallEntry[] = [];
  @state() private chosen = "";
  /** what was thrown away last, which can be undone */
  @state() private thrown: WallEntry | null = null;
  private number = 0;
  private timer = 0;
  private readonly end = new IntersectionObserver((entries) => entries.some((one) => one.isIntersecting) && void this.more());

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.listen((message) => this.receive(message));
    this.studio.addEventListener("renewed", () => this.later());
  }

  protected override updated(changed: Map<string, unknown>): void {
    if (changed.has("isShown") && this.isShown) void this.load();
    this.end.disconnect();
    const end = this.querySelector(".end-of-wall");
    if (end) this.end.observe(end);
  }

  private receive(message: ToPage): void {
    if (message.kind === "material_changed" && this.isShown) this.later();
  }

  private later(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.load(), PAUSE);
  }

  /** Ask again for as many as are shown. */
  private async load(): Promise<void> {
    const number = ++this.number;
    const wanted = Math.max(PAGE, this.shown.length);
    const shown: WallEntry[] = [];
    let found: Wall | undefined;
    do {
      found = await this.studio.attempt(wall(this.asked(shown.length)));
      if (!found || number !== this.number) return;
      shown.push(...found.shown);
    } while (found.shown.length && shown.length < Math.min(wanted, found.found));
    [this.found, this.shown] = [found, shown];
  }

  private async more(): Promise<void> {
    if (!this.found || this.shown.length >= this.found.found) return;
    const number = ++this.number;
    const found = await this.studio.attempt(wall(this.asked(this.shown.length)));
    if (!found || number !== this.number) return;
    const known = new Set(this.shown.map(({ id }) => id));
    [this.found, this.shown] = [found, [...this.shown, ...found.shown.filter(({ id }) => !known.has(id))]];
  }

  private asked(first: number): Record<string, string> {
    const { search, tag, favourites, deleted, sorting } = this.query;
    return { search, tag, favourites: String(favourites), deleted: String(deleted), sorting, first: String(first), count: String(PAGE) };
  }

  private ask(change: Partial<Query>): void {
    this.query = { ...this.query, ...change };
    [this.shown, this.chosen] = [[], "deleted" in change ? "" : this.chosen];
    this.later();
  }

  private async edit(id: string, change: MaterialRequest): Promise<boolean> {
    const made = await this.studio.attempt(editMaterial(id, change));
    await this.load();
    return made !== undefined;
  }

  private async throwAway(entry: WallEntry): Promise<void> {
    if (!(await this.edit(entry.id, { is_deleted: true }))) return;
    [this.thrown, this.chosen] = [entry, ""];
    if (this.studio.project.material?.id === entry.id) this.studio.project.close();
  }

  private async restore(entry: WallEntry): Promise<void> {
    if (await this.edit(entry.id, { is_deleted: false })) this.thrown = null;
  }

  private async duplicate(entry: WallEntry): Promise<void> {
    const made = await this.studio.attempt(duplicateMaterial(entry.id));
    await this.load();
    if (made) this.chosen = made.id;
  }

  override render(): TemplateResult {
    const { query, found, thrown } = this;
    const chosen = this.shown.find(({ id }) => id === this.chosen);
    return html`
      <aside class="left" aria-label="Find materials">
        <input type="text" aria-label="Search materials" placeholder="Search name, tag, method" .value=${query.search}
          @input=${(event: Event) => this.ask({ search: (event.target as HTMLInputElement).value })} />
        <label class="field wide"><span>Sorted by</span>
          <select aria-label="Sorted by" @change=${(event: Event) => this.ask({ sorting: (event.target as HTMLSelectElement).value as Query["sorting"] })}>
            ${Object.entries(SORTINGS).map(([one, label]) => html`<option value=${one} ?selected=${one === query.sorting}>${label}</option>`)}
          </select></label>
        <div class="list">
          <button aria-pressed=${!query.favourites && !query.deleted && !query.tag} @click=${() => this.ask({ favourites: false, deleted: false, tag: "" })}>All (${found?.kept ?? 0})</button>
          <button aria-pressed=${query.favourites} @click=${() => this.ask({ favourites: !query.favourites, deleted: false })}>★ Favourites</button>
          <button aria-pressed=${query.deleted} @click=${() => this.ask({ deleted: !query.deleted, favourites: false, tag: "" })}>Bin (${found?.deleted ?? 0})</button>
        </div>
        ${found && Object.keys(found.tags).length
          ? html`<h2>Tags</h2><div class="list">${Object.entries(found.tags).map(([tag, count]) => html`<button aria-pressed=${query.tag === tag}
              @click=${() => this.ask({ tag: query.tag === tag ? "" : tag, deleted: false })}>${tag} (${count})</button>`)}</div>`
          : nothing}
        ${found?.problems.length
          ? html`<h2>Not read</h2>${found.problems.map((one) => html`<p class="hint problem">${one}</p>`)}`
          : nothing}
      </aside>
      <section class="stage" aria-label="Materials">
        <div class="bar">
          <span class="state start" role="status">${this.counted()}</span>
          ${thrown
            ? html`<span>${thrown.name} is in the bin</span>
                <button data-step="undo" title="Undo (Ctrl+Z)" @click=${() => this.restore(thrown)}>Undo</button>`
            : nothing}
          <button class="primary" @click=${() => this.tell("open", "")}>New material</button>
        </div>
        ${this.found && !this.shown.length ? this.empty() : nothing}
        <ul class="materials" aria-label="Materials">
          ${repeat(this.shown, ({ id }) => id, (entry) => html`<li><material-card .entry=${entry} ?chosen=${entry.id === this.chosen}
            @open=${(event: CustomEvent<string>) => this.open(event)}
            @choose=${() => (this.chosen = entry.id)}
            @favourite=${() => this.edit(entry.id, { is_favourite: !entry.is_favourite })}></material-card></li>`)}
          <li class="end-of-wall" aria-hidden="true"></li>
        </ul>
      </section>
      <aside class="right" aria-label="The chosen material">
        ${chosen
          ? html`<material-details .studio=${this.studio} .entry=${chosen}
              @edit=${(event: CustomEvent<MaterialRequest>) => this.edit(chosen.id, event.detail)}
              @duplicate=${() => this.duplicate(chosen)} @discard=${() => this.throwAway(chosen)} @restore=${() => this.restore(chosen)}></material-details>`
          : html`<p class="hint">A click on a picture opens a material. ⋯ below it shows its name, tags and files.</p>`}
      </aside>
    `;
  }

  /** The bin opens nothing: what is in it is restored first. */
  private open(event: CustomEvent<string>): void {
    event.stopPropagation();
    if (this.query.deleted) this.chosen = event.detail;
    else this.tell("open", event.detail);
  }

  private counted(): string {
    const { found, shown, query } = this;
    if (!found) return "Reading the project …";
    const all = query.deleted ? found.deleted : found.kept;
    const matching = found.found === all ? `${all} material${all === 1 ? "" : "s"}` : `${found.found} of ${all} materials`;
    return `${matching}${query.deleted ? " in the bin" : ""}${shown.length < found.found ? `, ${shown.length} shown; scroll for more` : ""}`;
  }

  private empty(): TemplateResult {
    const { found, query } = this;
    if (query.deleted) return html`<div class="welcome"><p>The bin is empty.</p></div>`;
    if (found!.kept) return html`<div class="welcome"><p>No material is found. Change the search, or choose All.</p></div>`;
    return html`<div class="welcome"><h2>Nothing has been made yet</h2>
      <p>Choose New material, and a picture. What you try and make is kept here by itself, in ${this.studio.project.state.place}.</p></div>`;
  }
}
