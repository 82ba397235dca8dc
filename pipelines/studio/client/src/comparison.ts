// Another result of a material, with which what is shown is compared.
import type { Drawable } from "./picture-view";
import { bitmap, fileAddress } from "./server";
import type { Studio } from "./studio";

export class Comparison {
  /** the run; empty: none */
  job = "";
  picture: Drawable | null = null;

  constructor(private readonly studio: Studio) {}

  end(): void {
    [this.job, this.picture] = ["", null];
  }

  /** Compare with a run, or none; whether there is a picture of it. */
  async choose(job: string, file: string): Promise<boolean> {
    const loaded = job && (await this.studio.attempt(bitmap(fileAddress(job, file))));
    [this.job, this.picture] = loaded ? [job, loaded] : ["", null];
    return this.picture !== null;
  }
}
