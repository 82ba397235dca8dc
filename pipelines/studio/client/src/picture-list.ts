// The pictures to start from: dropped ones, those of the folder, examples.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, property, state } from "lit/decorators.js";
import { Element } from "./element";
import type { Picture, PicturePage } from "./messages";
import "./picture-search";
import type { Asked } from "./picture-search";
import { pictureAddress, pictures, RequestError, upload } from "./server";
import type { Studio } from "./studio";

const THUMBNAIL = 128; // px
const PAUSE = 200; // ms until a search begins

/** Tells `choose` with a picture that is clicked, and with one that is dropped; where it takes several, `add` with each. */
@customElement("picture-list")
export class PictureList extends Element {
  @property({ attribute: false }) studio!: Studio;
  /** the id of the one that is chosen, or of several */
  @property({ attribute: false }) chosen: string | readonly string[] = "";
  /** whether files that are dropped together are pictures of their own, not the maps of one material */
  @property({ attribute: false }) takesSeveral = false;
  @state() private isOver = false;
  @state() private busy = "";

  /** what is asked for, and what there is of it so far */
  @state() private asked: Asked = { search: "", folder: "", sorting: "name" };
  @state() private page: PicturePage | null = null;
  @state() private shown: Picture[] = [];
  private number = 0;
  private timer = 0;

  override connectedCallback(): void {
    super.connectedCallback();
    this.studio.addEventListener("change", () => this.requestUpdate());
  }

  protected override willUpdate(): void {
    if (this.page) return;
    this.page = this.studio.begin.listed;
    this.shown = this.page.pictures;
  }

  /** Ask for other pictures, when nobody types any more. */
  private search(asked: Asked): void {
    this.asked = asked;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.load(0), PAUSE);
  }

  /** Load the pictures from one on, those before it included in `page`. */
  private async load(first: number): Promise<void> {
    const number = ++this.number;
    const page = await this.studio.attempt(pictures({ ...this.asked, first: String(first) }));
    if (!page || number !== this.number) return;
    this.studio.know(page.pictures);
    this.shown = first ? [...this.shown, ...page.pictures] : page.pictures;
    this.page = { ...page, asked: first + page.asked };
  }

  /** Those that were dropped here come first, unless others are searched. */
  private get own(): Picture[] {
    const { search, folder } = this.asked;
    const added = search || folder ? [] : this.studio.added;
    return [...added, ...this.shown.filter((one) => added.every(({ id }) => id !== one.id))];
  }

  override render(): TemplateResult {
    const page = this.page!;
    const left = page.found - page.asked;
    return html`
      <label
        class="drop ${this.isOver ? "over" : ""}"
        @dragover=${() => (this.isOver = true)}
        @dragleave=${() => (this.isOver = false)}
        @drop=${() => (this.isOver = false)}
      >
        ${this.busy
          ? html`<span role="status">${this.busy}</span>`
          : html`<strong>Drop a picture</strong> or a folder of maps here, or click to choose`}
        <input
          type="file"
          multiple
          accept="image/*,.exr,.tif,.tiff"
          aria-label="Choose pictures"
          @change=${(event: Event) => {
            const input = event.target as HTMLInputElement;
            this.receive([...(input.files ?? [])], "");
            input.value = "";
          }}
        />
      </label>
      <picture-search .page=${page} .asked=${this.asked} @search=${(event: CustomEvent<Asked>) => this.search(event.detail)}></picture-search>
      ${this.group("Your pictures", this.own)}
      ${left > 0 ? html`<button class="more-pictures" @click=${() => this.load(page.asked)}>Show more (${left} are left)</button>` : nothing}
      ${page.notes.map((note) => html`<p class="hint">${note}</p>`)}
      ${this.group("Examples", this.studio.begin.examples)}
    `;
  }

  private group(title: string, pictures: Picture[]): TemplateResult | typeof nothing {
    if (!pictures.length) return nothing;
    return html`
      <h2>${title}</h2>
      <ul class="pictures">
        ${pictures.map(
          (one) => html`<li>
            <button
              aria-pressed=${[this.chosen].flat().includes(one.id)}
              title="${one.name}, ${one.width} × ${one.height} px${placeOf(one)}"
              @click=${() => this.tell("choose", one)}
            >
              <img src=${pictureAddress(one.id, THUMBNAIL)} alt="" loading="lazy" draggable="false" />
              <span>${one.name}${one.is_material ? html`<em> maps</em>` : nothing}</span>
            </button>
          </li>`,
        )}
      </ul>
    `;
  }

  /** Files that are dropped, or those of a folder, and its name. */
  static async filesIn(data: DataTransfer): Promise<[File[], string]> {
    const files = [...data.files]; // gone after the first wait
    const entries = [...data.items].map((item) => item.webkitGetAsEntry());
    const folder = entries.find((entry) => entry?.isDirectory) as FileSystemDirectoryEntry | undefined;
    return folder ? [await filesOf(folder), folder.name] : [files, ""];
  }

  /** Take a picture, or a material's maps, into the library, and choose it. */
  async receive(files: File[], name: string): Promise<void> {
    if (!files.length) return;
    this.busy = files.length > 1 ? `Reading ${files.length} files …` : `Reading ${files[0].name} …`;
    if (files.length === 1 && !this.takesSeveral) void this.studio.expect(files[0]);
    const pictures = (await this.studio.attempt(this.taken(files, name))) ?? [];
    this.busy = "";
    if (!pictures.length) void this.studio.expect(null);
    [...pictures].reverse().forEach((one) => this.studio.add(one));
    if (this.takesSeveral) pictures.forEach((one) => this.tell("add", one));
    else if (pictures.length) this.tell("choose", pictures[0]);
  }

  /** Files as the maps of one material, or as pictures of their own where they are no maps. */
  private async taken(files: File[], name: string): Promise<Picture[]> {
    const pictures: Picture[] = [];
    if (files.length === 1 || name || !this.takesSeveral) {
      try {
        return [await upload(files, name)];
      } catch (error) {
        if (files.length === 1 || name || !(error instanceof RequestError)) throw error;
      }
    }
    for (const file of files) pictures.push(await upload([file], ""));
    return pictures;
  }
}

/** The files in a dropped folder; folders inside of it are left out. */
async function filesOf(folder: FileSystemDirectoryEntry): Promise<File[]> {
  const reader = folder.createReader();
  const entries: FileSystemEntry[] = [];
  for (;;) {
    const some = await new Promise<FileSystemEntry[]>((done, fail) => reader.readEntries(done, fail)); // 100 at most
    if (some.length === 0) break;
    entries.push(...some);
  }
  const files = entries.filter((entry) => entry.isFile && !entry.name.startsWith("."));
  return Promise.all(
    files.map((entry) => new Promise<File>((done, fail) => (entry as FileSystemFileEntry).file(done, fail))),
  );
}

/** The folder of a picture, where it is not the studio's own. */
function placeOf({ id }: Picture): string {
  const folder = id.startsWith("folder:") ? id.slice("folder:".length).split("/").slice(0, -1).join("/") : "";
  return folder && `, in ${folder}`;
}
