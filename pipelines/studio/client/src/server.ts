// Talking to the server: requests over HTTP, and how messages are packed.
import type {
  Described, ExrContents, FlowEntry, Insight, Job, KeptPhoto, Material, MaterialRequest, OpenMaterial, PastRuns, PastStep, PhotoRecipe, Picture, PicturePage,
  Problem, ProjectState, ProjectViewRequest, Recipe, Start, ToPage, ToServer, Wall,
} from "./messages";

/** Why a request was refused, in one line for the user. */
export class RequestError extends Error {}
/** There is no server at present. */
export class NoAnswerError extends RequestError {}

const KEPT_ALIVE = 30_000; // characters; browsers refuse more than 64 kB

async function request(path: string, options: RequestInit = {}): Promise<Response> {
  let answer: Response;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new NoAnswerError("The studio does not answer. Is `texloom studio` still running?");
  }
  if (answer.ok) return answer;
  const text = await answer.text();
  let problem = text || `${answer.status} ${answer.statusText}`;
  try {
    problem = (JSON.parse(text) as Problem).problem ?? problem;
  } catch {
    // not JSON: the text itself says why
  }
  throw new RequestError(problem);
}

/** `isLast`: it is to arrive although the page is being closed, if that is possible. */
async function post<T>(path: string, body?: unknown, isLast = false): Promise<T> {
  const headers = { "content-type": "application/json" };
  const text = body === undefined ? undefined : JSON.stringify(body);
  const options = { method: "POST", headers, body: text, keepalive: isLast && (text?.length ?? 0) < KEPT_ALIVE };
  return (await (await request(path, options)).json()) as T;
}

export const start = async (): Promise<Start> => (await request("/api/start")).json();
export const describe = (recipe: Recipe): Promise<Described> => post("/api/described", recipe);
/** Write the geometry file of a photograph. */
export const keepPhoto = (recipe: PhotoRecipe): Promise<KeptPhoto> => post("/api/photographs", recipe);

/** What a run is for: a result of a material, which may correct another one, or files of a result for a program. */
export interface Purpose {
  material?: string;
  parent?: string;
  delivers?: string;
}
export const run = (recipe: Recipe, purpose: Purpose = {}): Promise<Job> =>
  post(`/api/jobs?${new URLSearchParams(purpose as Record<string, string>)}`, recipe);
export const cancel = (job: string): Promise<Response> => request(`/api/jobs/${job}`, { method: "DELETE" });

/** Run again what has failed or was cancelled. */
export const again = (job: string): Promise<Job> => post(`/api/jobs/${job}/again`);

/** Write the files of a run beside the pictures of the folder. */
export const save = (job: string): Promise<Job> => post(`/api/jobs/${job}/saved`);

export const pictureAddress = (id: string, side: number): string =>
  `/api/pictures?${new URLSearchParams({ id, side: String(side) })}`;
export const fileAddress = (job: string, file: string): string =>
  `/api/jobs/${job}/files/${file.split("/").map(encodeURIComponent).join("/")}`;

/** All files of a run in one. */
export const allAddress = (job: string): string => `/api/jobs/${job}/all`;

// -- the project
export const project = async (): Promise<ProjectState> => (await request("/api/project")).json();
export const lookAt = (view: ProjectViewRequest): Promise<null> => post("/api/project/view", view, true);
export const createMaterial = (recipe: Recipe): Promise<Material> => post("/api/materials", recipe);
export const openMaterial = async (id: string): Promise<OpenMaterial> => (await request(`/api/materials/${id}`)).json();
export const editMaterial = (id: string, change: MaterialRequest): Promise<Material> => post(`/api/materials/${id}`, change, true);
export const duplicateMaterial = (id: string): Promise<Material> => post(`/api/materials/${id}/duplicate`);
export const wall = async (query: Record<string, string>): Promise<Wall> =>
  (await request(`/api/materials?${new URLSearchParams(query)}`)).json();
export const pictures = async (query: Record<string, string>): Promise<PicturePage> =>
  (await request(`/api/library?${new URLSearchParams(query)}`)).json();
export const thumbnailAddress = (job: string): string => `/api/thumbnails/${job}`;

export const runs = async (): Promise<PastRuns> => (await request("/api/runs")).json();
export const steps = async (id: string): Promise<PastStep[]> => (await request(`/api/runs/${id}`)).json();
export const flows = async (): Promise<FlowEntry[]> => (await request("/api/flows")).json();
export const layers = async (item: string): Promise<ExrContents> =>
  (await request(`/api/layers?${new URLSearchParams({ item })}`)).json();
/** The corners of a mesh with texture coordinates for a texture of ``side`` px. */
export const mesh = async (id: string, side: number): Promise<Float32Array> =>
  new Float32Array(await (await request(`/api/meshes?${new URLSearchParams({ id, side: String(side) })}`)).arrayBuffer());
export const tile = (key: string, layer: number, level: number, row: number, column: number): Promise<ImageBitmap> =>
  bitmap(`/api/tiles/${key}/${layer}/${level}/${row}/${column}`);
/** A tile of an endless texture, whose own window begins at tile (0, 0). */
export const endlessTile = (job: string, level: number, row: number, column: number): Promise<ImageBitmap> =>
  bitmap(`/api/endless/${job}/${level}/${row}/${column}`);
export const resultAddress = (key: string, output: string): string => `/api/results/${key}/${output}.png`;

/** What a result tells of itself, and where its pixels come from: row and column of each in turn. */
export async function insight(job: string): Promise<[Insight, Uint16Array]> {
  const [message, payload] = unpacked<Insight>(await (await request(`/api/jobs/${job}/insight`)).arrayBuffer());
  return [message, new Uint16Array(payload.slice().buffer)];
}

/** An image that the server has, decoded. */
export async function bitmap(address: string): Promise<ImageBitmap> {
  return createImageBitmap(await (await request(address)).blob());
}

/** Send files that were dropped or chosen: one picture, or the maps of one material. */
export const upload = async (files: File[], name: string): Promise<Picture> =>
  post(`/api/received/${await sent(files)}?${new URLSearchParams({ name })}`);

/** Send a mesh; its id. */
export const uploadMesh = async (file: File): Promise<string> => post(`/api/received/${await sent([file])}/mesh`);

/** The key of files that the server has now. */
async function sent(files: File[]): Promise<string> {
  const key = await post<string>("/api/receiving");
  for (const file of files) {
    await request(`/api/received/${key}/${encodeURIComponent(file.name)}`, { method: "PUT", body: file });
  }
  return key;
}

/** Begins the name of what the page paints, which is no exemplar. */
export const PAINTED = "painted_";

/** Keep a document, such as the pieces of a collage; its id. */
export const keepDocument = (name: string, content: object): Promise<string> => post(`/api/documents/${name}`, content);

/** Pack a message as it goes over the socket after its two numbers, and unpack an answer. */
export function packed(message: ToServer, payload: Uint8Array): Uint8Array<ArrayBuffer> {
  const header = new TextEncoder().encode(JSON.stringify(message));
  const frame = new Uint8Array(4 + header.length + payload.length);
  new DataView(frame.buffer).setUint32(0, header.length, true);
  frame.set(header, 4);
  frame.set(payload, 4 + header.length);
  return frame;
}

export function unpacked<T = ToPage>(frame: ArrayBuffer): [T, Uint8ClampedArray<ArrayBuffer>] {
  const length = new DataView(frame).getUint32(0, true);
  const header = new TextDecoder().decode(new Uint8Array(frame, 4, length));
  return [JSON.parse(header) as T, new Uint8ClampedArray(frame, 4 + length)];
}
