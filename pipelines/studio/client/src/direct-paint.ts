// Painted layers that direct a texture: what is excluded, structure, labels or values, and direction.
import { html, nothing, type TemplateResult } from "lit";
import { customElement, state } from "lit/decorators.js";
import { DirectMode } from "./direct-mode";
import { type Draft, picture } from "./drafts";
import { amount, choice, slider } from "./fields";
import { KIND } from "./layers";
import type { Drawing, Recipe } from "./messages";
import { Changes, connected, flattened, Layer } from "./painting";
import type { Act, Over, Point } from "./picture-view";

type Side = "exemplar" | "target";
type Name = "mask" | "structure" | "labels" | "values" | "direction";

const KINDS: Record<Name, { title: string; sides: Side[]; hint: string }> = {
  mask: { title: "Leave out", sides: ["exemplar"], hint: "What is never copied nor looked at: logos, borders, damage." },
  structure: { title: "Structure", sides: ["exemplar"], hint: "What must stay connected, in place of what is detected." },
  labels: {
    title: "Areas", sides: ["exemplar", "target"],
    hint: "What lies where in the exemplar, left, and what is to lie where in the result, right. What is not painted is the first area in the exemplar, and free in the result.",
  },
  values: {
    title: "Amount", sides: ["exemplar", "target"],
    hint: "How much of something, such as age, rust or height, in the exemplar, left, and in the result, right. What is not painted is 0 in the exemplar, and free in the result.",
  },
  direction: { title: "Direction", sides: ["target"], hint: "Lines along which the texture is to run, in the result." },
};
const LABELS = ["#8a9199", "#4c6ef5", "#f76707", "#37b24d", "#ae3ec9", "#fab005"];
const COLOR_NAMES = ["Grey", "Blue", "Orange", "Green", "Violet", "Yellow"];
const MOST_NAME = 16; // characters
const namesKey = (picture: string): string => `texloom areas ${picture}`; // what each label is, of a picture
const COLORS: Partial<Record<Name, string>> = { mask: "#e5484d", structure: "#22b8cf", direction: "#ffe066" };
/** what of a recipe each kind is */
const SOURCES: Record<Name, string[]> = {
  mask: [], structure: ["exemplar_structure"], labels: ["exemplar_guide", "target_guide"], values: ["exemplar_guide", "target_guide"], direction: ["strokes"],
};
const GUIDES: Name[] = ["labels", "values", "direction"];
const TOOLS = { brush: "Brush", eraser: "Eraser", fill: "Fill" } as const;
const LINE = 0.006; // of the result's longer side: width of a direction's line
const SIDES = { exemplar: "Exemplar", target: "Result" } as const;

@customElement("direct-paint")
export class DirectPaint extends DirectMode {
  protected readonly layer = "guides";
  protected readonly flow = "self_tuning";
  @state() private kind: Name = "mask";
  @state() private tool: keyof typeof TOOLS = "brush";
  @state() private radius = 16;
  @state() private tolerance = 24;
  @state() private label = 1;
  @state() private names: Record<number, string> = {};
  @state() private value = 255;
  @state() private cover = 60;
  @state() private guide: Name = "labels";
  protected history = new Changes();
  private layers = new Map<string, Layer>();
  /** the recipe, of which what was drawn before the page was loaded again stays until it is drawn anew or cleared */
  private given!: Recipe;
  private hovered: { side: Side; at: Point } | null = null;
  private last: Point | null = null;

  protected reset(): void {
    this.layers.clear();
    this.history = new Changes();
    this.given = this.recipe;
    this.names = JSON.parse(localStorage.getItem(namesKey(this.picture.id)) ?? "{}");
  }

  /** It is in the sources of the recipe. */
  protected drawing(): Partial<Drawing> {
    return {};
  }

  private nameOf(label: number): string {
    return this.names[label] || COLOR_NAMES[label];
  }

  /** Give the label a name, which is kept with the picture. */
  private call(name: string): void {
    this.names = { ...this.names, [this.label]: name };
    localStorage.setItem(namesKey(this.picture.id), JSON.stringify(this.names));
  }

  /** A layer, which is made when it is first painted. */
  private of(name: Name, side: Side): Layer {
    const key = `${name}:${side}`;
    const [height, width] = side === "exemplar" ? [this.picture.height, this.picture.width] : this.size;
    let layer = this.layers.get(key);
    if (!layer) this.layers.set(key, (layer = new Layer(width, height)));
    return layer;
  }

  private painted(name: Name, side: Side): Layer | null {
    const layer = this.layers.get(`${name}:${side}`);
    return layer && !layer.isEmpty ? layer : null;
  }

  protected override resize(size: [number, number]): void {
    super.resize(size);
    for (const [key, layer] of this.layers) {
      if (!key.endsWith(":target")) continue;
      const resized = new Layer(size[1], size[0]);
      resized.context.imageSmoothingEnabled = false; // labels keep their colours
      resized.context.drawImage(layer.canvas, 0, 0, size[1], size[0]);
      this.layers.set(key, resized);
    }
    this.history = new Changes();
  }

  // -- painting

  private get color(): string {
    if (this.kind === "labels") return LABELS[this.label];
    return COLORS[this.kind] ?? `rgb(${this.value} ${this.value} ${this.value})`;
  }

  private act(side: Side, { phase, x, y, isOther }: Act): void {
    const at = { x, y };
    this.hovered = phase === "leave" ? null : { side, at };
    if (!KINDS[this.kind].sides.includes(side)) {
      if (phase === "begin") this.refuse(`${KINDS[this.kind].title} is painted over the ${SIDES[KINDS[this.kind].sides[0]].toLowerCase()}`);
    } else if (phase === "begin") {
      const layer = this.of(this.kind, side);
      this.history.begin(layer);
      if (this.tool === "fill" && this.kind !== "direction") this.fill(side, layer, at, isOther);
      else this.line(layer, at, at, isOther);
      this.last = at;
    } else if (phase === "drag" && this.last && this.tool !== "fill") {
      this.line(this.of(this.kind, side), this.last, at, isOther);
      this.last = at;
    } else if (phase === "end" && this.last) {
      this.last = null;
      if (this.history.end()) this.painted_();
    } else if (phase === "cancel") {
      this.last = null;
      this.history.cancel();
    }
    this.redraw();
  }

  private painted_(): void {
    if (GUIDES.includes(this.kind)) this.guide = this.kind;
    this.changed();
  }

  private line(layer: Layer, from: Point, to: Point, isOther: boolean): void {
    const erases = this.tool === "eraser" || isOther;
    const width = this.kind === "direction" && !erases ? this.lineRadius : this.radius;
    this.history.touched(layer.line(from, to, width, erases ? null : this.color));
  }

  private get lineRadius(): number {
    return Math.max(1.5, (LINE * Math.max(...this.size)) / 2);
  }

  /** Fill what is connected: of like colour in the exemplar, or painted alike in the result. */
  private fill(side: Side, layer: Layer, at: Point, isOther: boolean): void {
    if (at.x < 0 || at.y < 0 || at.x >= layer.width || at.y >= layer.height) return;
    const seen = side === "exemplar" ? new Layer(layer.width, layer.height) : layer;
    if (side === "exemplar") seen.context.drawImage(this.exemplar!, 0, 0, layer.width, layer.height);
    const chosen = connected(seen.read(seen.whole), at, this.tolerance);
    const brush = new Layer(1, 1);
    brush.line({ x: 0.5, y: 0.5 }, { x: 0.5, y: 0.5 }, 2, this.color);
    const [red, green, blue] = brush.read(brush.whole).data;
    this.history.touched(layer.flood(chosen, isOther ? [0, 0, 0, 0] : [red, green, blue, 255]));
  }

  private clear(): void {
    this.given = { ...this.given, mask: this.kind === "mask" ? null : this.given.mask, sources: without(this.given.sources, SOURCES[this.kind]) };
    for (const side of KINDS[this.kind].sides) {
      const layer = this.painted(this.kind, side);
      if (!layer) continue;
      this.history.begin(layer);
      layer.context.clearRect(0, 0, layer.width, layer.height);
      this.history.touched(layer.whole);
      this.history.end();
    }
    this.changed();
    this.redraw();
  }

  protected stepBy(direction: "undo" | "redo"): void {
    this.history[direction]();
    this.changed();
    this.redraw();
  }

  protected override onKey(key: string): boolean {
    const tools: Record<string, keyof typeof TOOLS> = { b: "brush", e: "eraser", f: "fill" };
    if (tools[key]) this.tool = tools[key];
    else if (key === "[" || key === "]") this.radius = Math.max(1, Math.round(this.radius * (key === "[" ? 0.8 : 1.25) + (key === "]" ? 0.5 : 0)));
    else return false;
    this.redraw();
    return true;
  }

  // -- what it makes

  protected async draft(): Promise<Draft | string> {
    const attached: Record<string, Blob> = {};
    const attach = async (name: string, canvas: HTMLCanvasElement): Promise<string> => {
      attached[name] = await picture(canvas);
      return `attached:${name}`;
    };
    const given = Object.entries(this.given.sources).filter(([name]) => Object.values(SOURCES).flat().includes(name));
    let sources: Recipe["sources"] = Object.fromEntries(given);
    const [mask, structure] = [this.painted("mask", "exemplar"), this.painted("structure", "exemplar")];
    if (structure) sources.exemplar_structure = await attach("structure.png", flattened(structure, "#000", "#fff"));
    const guide = [this.guide, ...GUIDES].find((one) => this.painted(one, "target"));
    let params: Recipe["params"] = sources.target_guide ? { [KIND]: this.given.params?.[KIND] ?? "labels" } : {};
    if (guide) sources = without(sources, GUIDES.flatMap((one) => SOURCES[one]));
    if (guide === "direction") {
      sources.strokes = await attach("strokes.png", this.of("direction", "target").canvas);
    } else if (guide) {
      const own = this.painted(guide, "exemplar");
      if (!own) return `Paint ${KINDS[guide].title.toLowerCase()} over the exemplar too, on the left`;
      sources.exemplar_guide = await attach("exemplar_guide.png", flattened(own, guide === "labels" ? LABELS[0] : "#000", null));
      sources.target_guide = await attach("target_guide.png", this.of(guide, "target").canvas);
      params = { [KIND]: guide };
    } else if (this.painted("labels", "exemplar") || this.painted("values", "exemplar")) {
      return "Now paint what is to lie where in the result, on the right";
    }
    const drawn = this.base(this.flow, sources, params);
    const keepsMethod = !Object.keys(sources).length && !this.studio.begin.methods.find(({ flow }) => flow === this.recipe.flow)?.layer;
    const recipe = keepsMethod ? { ...this.recipe, size: drawn.size, seed: drawn.seed, tileable: drawn.tileable } : drawn;
    recipe.mask = mask ? await attach("mask.png", flattened(mask, "#fff", "#000")) : this.given.mask;
    return { recipe, attached };
  }

  protected override explained(problem: string): string {
    if (problem.includes("few flat colours")) return "Paint larger areas over the exemplar; these are too small to be recognised";
    if (problem.includes("is no label of exemplar_guide")) return "An area of the result is not painted over the exemplar; paint it there too, or erase it";
    return problem;
  }

  // -- how it looks

  protected hint(): string {
    return "Paint over the exemplar or the result; the preview follows each stroke";
  }

  private over(side: Side): Over {
    return (context, at, scale) => {
      const [left, top] = at({ x: 0, y: 0 });
      for (const [key, layer] of this.layers) {
        if (!key.endsWith(`:${side}`)) continue;
        context.globalAlpha = (this.cover / 100) * (key.startsWith(this.kind) ? 1 : 0.5);
        context.imageSmoothingEnabled = scale < 3;
        context.drawImage(layer.canvas, left, top, layer.width * scale, layer.height * scale);
      }
      context.globalAlpha = 1;
      if (this.hovered?.side !== side || this.tool === "fill" || !KINDS[this.kind].sides.includes(side)) return;
      const isLine = this.kind === "direction" && this.tool === "brush";
      for (const [style, width] of [["rgb(0 0 0 / 0.6)", 3], ["#fff", 1.2]] as const) {
        [context.strokeStyle, context.lineWidth] = [style, width];
        context.beginPath();
        context.arc(...at(this.hovered.at), (isLine ? this.lineRadius : this.radius) * scale, 0, 2 * Math.PI);
        context.stroke();
      }
    };
  }
  private readonly overs = { exemplar: this.over("exemplar"), target: this.over("target") };

  protected panes(): TemplateResult {
    const extents = { exemplar: [this.picture.height, this.picture.width], target: this.size };
    return html`${(["exemplar", "target"] as const).map((side) => html`<figure>
      <figcaption>${SIDES[side]}</figcaption>
      <picture-view class=${KINDS[this.kind].sides.includes(side) ? "tool" : ""} tool="act" label=${SIDES[side]}
        .picture=${side === "exemplar" ? this.exemplar : this.shown} .tiles=${side === "exemplar" ? this.exemplarTiles : null} .extent=${extents[side]} .over=${this.overs[side]}
        @act=${(event: CustomEvent<Act>) => this.act(side, event.detail)}></picture-view>
    </figure>`)}`;
  }

  protected tools(): TemplateResult {
    const titles = Object.fromEntries(Object.entries(KINDS).map(([name, { title }]) => [name, title])) as Record<Name, string>;
    return html`
      <div class="layers">${choice("What is painted", titles, this.kind, (name) => (this.kind = name))}</div>
      <p class="hint">${KINDS[this.kind].hint}${this.given.flow === this.flow || this.kind === "mask" ? "" : " It makes the colour alone, with the method All-round."}</p>
      ${this.kind === "labels" ? html`<div class="chips labels" role="radiogroup" aria-label="Area">${LABELS.map((color, index) => html`<button
          role="radio" aria-checked=${index === this.label} style="--label: ${color}" @click=${() => (this.label = index)}>${this.nameOf(index)}</button>`)}</div>
        <label class="field"><span>Called</span><input type="text" aria-label="Name of the area" maxlength=${MOST_NAME} placeholder="such as moss"
          .value=${this.names[this.label] ?? ""} @change=${(event: Event) => this.call((event.target as HTMLInputElement).value.trim())} /></label>` : nothing}
      ${this.kind === "values" ? amount("Amount", this.value, (value) => (this.value = value)) : nothing}
      ${choice("Tool", TOOLS, this.tool, (tool) => (this.tool = tool))}
      ${this.tool === "fill"
        ? slider("Colours that count as alike", this.tolerance, 128, (value) => (this.tolerance = value))
        : slider("Brush radius, px", this.radius, 200, (value) => (this.radius = Math.max(1, value)))}
      ${slider("Cover, %", this.cover, 100, (value) => {
        this.cover = value;
        this.redraw();
      })}
      <button @click=${() => this.clear()}>Clear this layer</button>
    `;
  }
}

const without = <Value>(values: Record<string, Value>, names: string[]): Record<string, Value> =>
  Object.fromEntries(Object.entries(values).filter(([name]) => !names.includes(name)));
