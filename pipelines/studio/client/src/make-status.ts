// What a person is told of a texture that is being made.
import type { MadeResults } from "./made-results";

/** How far it is; ``scale`` is that of the preview, 0 where there is none yet; ``isRefined`` where a finer one follows; ``canWait`` where there is one. */
export function statusOf({ job, runs }: MadeResults, lacking: string, isWaiting: boolean, scale: number, isRefined: boolean, canWait: boolean): string {
  if (lacking) return `Choose: ${lacking.toLowerCase()}`;
  if (!job && !canWait) return "Finish it to see it; what is drawn so has no preview";
  if (job?.state === "done") return runs.canUndo ? "Full size, corrected" : `Full size, seed ${job.recipe.seed}`;
  if (job?.recipe.flow === "revise") return "Keeping the correction …";
  if (job?.state === "running") return "Running at full size; scales appear as they finish";
  if (isWaiting) return scale ? "Refining the preview …" : "Preparing the first preview …";
  const percent = Math.round(100 * scale);
  if (isRefined) return `Preview at ${percent} % of the size; a finer one is being made …`;
  return percent < 100 ? `Preview at ${percent} % of the size; the full size has its own details` : "Preview at full size";
}

/** What is shown before there is a picture. */
export function waitsFor(lacking: string, results: MadeResults, canWait: boolean): string {
  if (lacking) return `Choose on the right: ${lacking.toLowerCase()}`;
  if (results.job?.state === "done") return "Reading the result …";
  if (!results.id && !canWait) return "Finish it on the right, or draw more on its layer";
  return results.id ? "The first scale is being made …" : "The picture is being analysed …";
}
