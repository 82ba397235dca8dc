// Written by texloom.pipelines.studio.typescript from the room messages; do not edit.

export interface Picture {
  id: string;
  name: string;
  height: number;
  width: number;
  is_material: boolean;
  is_photograph: boolean;
}

export interface PicturePage {
  pictures: (Picture)[];
  asked: number;
  found: number;
  total: number;
  folders: Record<string, number>;
  notes: (string)[];
}

export interface OtherPicture {
  source: string;
  about: string;
  is_required: boolean;
  painted: [string, string] | null;
}

export interface SeveralPictures {
  source: string;
  least: number;
  most: number;
  is_ordered: boolean;
  ends: [string, string];
  weights: string;
}

export interface Control {
  param: string;
  label: string;
  least: number;
  most: number;
  default: number;
  ends: [string, string];
  is_switch: boolean;
  card: "light" | "region" | "maps" | "make";
}

export interface Setting {
  name: string;
  params: Record<string, number | boolean | "labels" | "values" | "noise" | "cells" | "corners" | "deep" | "high" | string | [number, number]>;
  lists: Record<string, (number)[]>;
  udim: string;
}

export interface Picker {
  label: string;
  settings: (Setting)[];
  without: string;
  card: "light" | "region" | "maps" | "make";
}

export interface ResultPicture {
  file: string;
  name: string;
}

export interface Method {
  flow: string;
  about: string;
  exemplar: string;
  begins: "picture" | "maps" | "photograph";
  has_maps: boolean;
  size: string | null;
  can_tile: boolean;
  tiles: boolean;
  presets: (string)[];
  uniformity: string;
  default_uniformity: number;
  others: (OtherPicture)[];
  several: SeveralPictures | null;
  choices: (Picker)[];
  controls: (Control)[];
  views: (ResultPicture)[];
  is_texture: boolean;
  can_correct: boolean;
  layer: "" | "collage" | "paint" | "mesh" | "surfaces";
}

export interface Start {
  folder: string;
  store: string;
  version: string;
  listed: PicturePage;
  examples: (Picture)[];
  meshes: (string)[];
  mesh_suffixes: (string)[];
  methods: (Method)[];
  layouts: (string)[];
}

export interface Problem {
  problem: string;
}

export interface Recipe {
  flow: string;
  sources: Record<string, string | (string)[]>;
  mask?: string | null;
  size?: string | null;
  tileable?: "off" | "x" | "y" | "both" | null;
  seed?: number;
  preset?: string | null;
  params?: Record<string, number | boolean | "labels" | "values" | "noise" | "cells" | "corners" | "deep" | "high" | string | [number, number]>;
  lists?: Record<string, (number)[]>;
  files?: Record<string, string>;
  layout?: string | null;
  udim?: string | null;
  material?: string | null;
}

export interface PatchRecipe {
  name: string;
  corners?: [[number, number], [number, number], [number, number], [number, number]] | null;
  controls?: [[[number, number], [number, number], [number, number], [number, number]], [[number, number], [number, number], [number, number], [number, number]], [[number, number], [number, number], [number, number], [number, number]], [[number, number], [number, number], [number, number], [number, number]]] | null;
  weights?: [[number, number, number, number], [number, number, number, number], [number, number, number, number], [number, number, number, number]] | null;
  size?: string | null;
  edge?: number | null;
}

export interface BrushRecipe {
  tool: "stroke" | "outline" | "fill" | "features";
  erase?: boolean;
  points?: ([number, number])[];
  radius?: number;
  tolerance?: number;
  features?: "dark" | "bright" | "both";
}

export interface PhotoRecipe {
  photo: string;
  patches?: (PatchRecipe)[];
  areas?: Record<string, (BrushRecipe)[]>;
}

export interface KeptPhoto {
  kind: "kept_photo";
  geometry: string;
}

export interface Described {
  yaml: string;
  file: string;
  command: string;
  steps: (PlannedStep)[];
}

export interface PlannedStep {
  name: string;
  state: "cached" | "run" | "wait" | "refused";
  reasons: (string)[];
}

export interface Queued {
  id: string;
  state: "waiting" | "running" | "done" | "failed" | "cancelled";
  step: string;
  text: string;
  done: number;
  seconds: number;
}

export interface Job {
  id: string;
  state: "waiting" | "running" | "done" | "failed" | "cancelled";
  step: string;
  text: string;
  done: number;
  seconds: number;
  name: string;
  recipe: Recipe;
  files: (string)[];
  saved: string;
  scores: Record<string, number>;
  texture: string;
  exemplar: string;
  maps: Record<string, string>;
}

export interface PastStep {
  name: string;
  stage: string;
  key: string;
  seconds: number;
  pictures: (string)[];
  params: Record<string, string>;
}

export interface PastRun {
  id: string;
  flow: string;
  sources: Record<string, string>;
  seeds: (number)[];
  used: number;
  cover: string;
}

export interface PastRuns {
  runs: (PastRun)[];
  found: number;
  corrections: number;
}

export interface FlowEntry {
  name: string;
  about: string;
}

export interface BadPlace {
  row: number;
  column: number;
  value: number;
}

export interface Insight {
  height: number;
  width: number;
  places: (BadPlace)[];
}

export interface Layer {
  name: string;
  height: number;
  width: number;
}

export interface ExrContents {
  key: string;
  layers: (Layer)[];
  about: string;
}

export interface DrawnPlace {
  x: number;
  y: number;
}

export interface Piece {
  outline: (DrawnPlace)[];
  at: DrawnPlace;
  angle: number;
  scale: number;
}

export interface DrawnCollage {
  pieces: (Piece)[];
  strength: number;
}

export interface DrawnMesh {
  mesh: string;
  side: number;
  control: string;
  strokes: (([number, number, number, number, number, number, number, number])[])[];
  amounts: string;
}

export interface DrawnPaint {
  control: string;
  side: number;
  map: string;
}

export interface Drawing {
  picture: string;
  collage: DrawnCollage | null;
  lattice: LatticeVertices | null;
  mesh: DrawnMesh | null;
  paint: DrawnPaint | null;
  surfaces: PhotoRecipe | null;
}

export interface Variant {
  job: Job;
  made: number;
  parent: string;
  folder: string;
  starts: number;
}

export interface Material {
  version: number;
  id: string;
  name: string;
  is_named: boolean;
  tags: (string)[];
  is_favourite: boolean;
  is_deleted: boolean;
  made: number;
  changed: number;
  draft: Recipe | null;
  shown: string;
  mode: string;
  file: string;
  drawing: Drawing;
  saved_as: (string)[];
  variants: (Variant)[];
}

export interface OpenMaterial {
  material: Material;
  pictures: (Picture)[];
  missing: (string)[];
}

export interface MaterialRequest {
  name?: string | null;
  tags?: (string)[] | null;
  is_favourite?: boolean | null;
  is_deleted?: boolean | null;
  draft?: Recipe | null;
  shown?: string | null;
  mode?: string | null;
  file?: string | null;
  drawing?: Drawing | null;
}

export interface WallEntry {
  id: string;
  name: string;
  tags: (string)[];
  is_favourite: boolean;
  is_deleted: boolean;
  flow: string;
  changed: number;
  results: number;
  is_running: boolean;
  cover: string;
  picture: string;
}

export interface Wall {
  shown: (WallEntry)[];
  first: number;
  found: number;
  kept: number;
  deleted: number;
  tags: Record<string, number>;
  problems: (string)[];
}

export interface ProjectView {
  view: string;
  material: string;
}

export interface ProjectViewRequest {
  view?: string;
  material?: string;
}

export interface ProjectState {
  name: string;
  place: string;
  view: ProjectView;
  materials: number;
  problem: string;
}

export interface MaterialChanged {
  kind: "material_changed";
  id: string;
}

export interface ProjectSaved {
  kind: "project_saved";
  problem: string;
}

export interface PreviewRequest {
  kind: "preview";
  number: number;
  recipe: Recipe;
  attached?: Record<string, number>;
  largest?: number;
}

export interface PreviewStopRequest {
  kind: "preview_stop";
}

export interface AlternativesRequest {
  kind: "alternatives";
  number: number;
  recipe: Recipe;
  seeds: (number)[];
}

export interface PaintSummaryRequest {
  kind: "paint_summary";
  number: number;
  texture: string;
  control: string;
  seed?: number;
}

export interface PaintOpenRequest {
  kind: "paint_open";
  number: number;
  texture: string;
  control: string;
  size: string;
  seed?: number;
  scale?: number;
}

export interface PaintDabRequest {
  kind: "paint_dab";
  number: number;
  top: number;
  left: number;
  height: number;
  width: number;
}

export interface PhotoRequest {
  kind: "photo";
  number: number;
  recipe: PhotoRecipe;
  patch?: string;
  side?: number;
  streamlines?: boolean;
  propose?: boolean;
}

export interface LatticeVertices {
  vertices: ([number, number, number, number])[];
  generators: [[number, number], [number, number]] | null;
}

export interface LatticeRequest {
  kind: "lattice";
  number: number;
  picture: string;
  lattice?: LatticeVertices | null;
}

export interface Connected {
  kind: "connected";
  is_new: boolean;
}

export interface PreviewPicture {
  kind: "preview_picture";
  number: number;
  height: number;
  width: number;
  scale: number;
  done: number;
  is_final: boolean;
}

export interface AlternativePicture {
  kind: "alternative_picture";
  number: number;
  seed: number;
  top: number;
  left: number;
  height: number;
  width: number;
}

export interface PaintProgress {
  kind: "paint_progress";
  number: number;
  step: string;
  done: number;
}

export interface PaintSummarised {
  kind: "paint_summarised";
  number: number;
}

export interface PaintOpened {
  kind: "paint_opened";
  number: number;
  control: string;
}

export interface PaintPicture {
  kind: "paint_picture";
  number: number;
  top: number;
  left: number;
  height: number;
  width: number;
}

export interface PhotoPatch {
  name: string;
  problem: string;
  rows: (number)[];
  columns: (number)[];
}

export interface PhotoState {
  kind: "photo_state";
  number: number;
  patches: (PhotoPatch)[];
}

export interface PhotoProposal {
  kind: "photo_proposal";
  number: number;
  planes: ([[number, number], [number, number], [number, number], [number, number]])[];
}

export interface PhotoPreview {
  kind: "photo_preview";
  number: number;
  height: number;
  width: number;
}

export interface PhotoArea {
  kind: "photo_area";
  number: number;
  name: string;
  height: number;
  width: number;
}

export interface PhotoLines {
  kind: "photo_lines";
  number: number;
  lines: number;
  points: number;
}

export interface LatticePicture {
  kind: "lattice_picture";
  number: number;
  lattice: LatticeVertices;
  vertices: ([number, number, number, number])[];
  problem: string;
  height: number;
  width: number;
}

export interface PreviewFailed {
  kind: "preview_failed";
  number: number;
  problem: string;
}

export interface JobChanged {
  kind: "job_changed";
  job: Job;
}

export interface JobPicture {
  kind: "job_picture";
  job: string;
  height: number;
  width: number;
}

export type ToServer = AlternativesRequest | LatticeRequest | PaintDabRequest | PaintOpenRequest | PaintSummaryRequest | PhotoRequest | PreviewRequest | PreviewStopRequest;

export type ToPage = AlternativePicture | MaterialChanged | ProjectSaved | Connected | LatticePicture | PaintOpened | PaintPicture | PaintProgress | PaintSummarised | PhotoArea | PhotoLines | PhotoPreview | PhotoProposal | PhotoState | PreviewPicture | PreviewFailed | JobChanged | JobPicture;
