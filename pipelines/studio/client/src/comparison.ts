// Another result of a material, with which what is shown is compared.
import type { Drawable } from "./picture-view";
import { viewedFile } from "./large-pictures";
import type { Studio } from "./studio";
import type { Tiles } from "./tiles";

export class Comparison {
  /** the run; empty: none */
  job = "";
  picture: Drawable | null = null;
  tiles: Tiles | null = null;

  constructor(private readonly studio: Studio) {}

  end(): void {
    [this.job, this.picture, this.tiles] = ["", null, null];
  }

  /** Compare with a run, or none; whether there is a picture of it. */
  async choose(job: string, file: string): Promise<boolean> {
    const made = this.studio.jobs.get(job);
    const loaded = made && (await this.studio.attempt(viewedFile(made, file)));
    [this.job, this.picture, this.tiles] = loaded ? [job, loaded.picture, loaded.tiles] : ["", null, null];
    return this.picture !== null;
  }
}
