// A layer of any size, or an endless texture, of which only the tiles in view are loaded.
import { customElement } from "lit/decorators.js";
import { PictureView } from "./picture-view";
import { ENDLESS_LEVELS, type Tiles } from "./tiles";

@customElement("tiled-view")
export class TiledView extends PictureView {
  protected override get scale(): number {
    return this.tiles?.endless && !this.zoom ? 1 : super.scale;
  }

  protected override get smallest(): number {
    return this.tiles?.endless ? 1 / 2 ** ENDLESS_LEVELS / devicePixelRatio : super.smallest;
  }

  protected override willUpdate(changed: Map<string, unknown>): void {
    const before = changed.get("tiles") as Tiles | null | undefined;
    if (before && this.tiles && (before.width !== this.tiles.width || before.height !== this.tiles.height)) this.fit();
  }
}
