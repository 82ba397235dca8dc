"""Make the pictures of the README by texloom's own commands: ``python docs/make_pictures.py``."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.edges import EdgesParams, edges
from texloom.stages.analysis.otsu import OtsuParams, otsu
from texloom.stages.arrays import Image as Exemplar
from texloom.stages.color import linear_from_srgb, srgb_from_linear

PICTURES = Path(__file__).parent / "pictures"
GAP = 12  # px


def synthesise(folder: Path, flow: str, *options: str) -> Image.Image:
    """The texture that a command makes."""
    out = folder / str(len(list(folder.iterdir())))
    command = ["run", flow, "--store", str(folder / "store"), "--out", str(out), *options]
    subprocess.run([sys.executable, "-m", "pipelines", *command], check=True)  # noqa: S603
    return Image.open(out / "texture.png").convert("L")


def exemplar(name: str) -> Image.Image:
    """A texture that comes with scikit-image."""
    pixels = open_source("exemplar", name).read().color
    return Image.fromarray(np.rint(255 * srgb_from_linear(pixels)).astype(np.uint8)).convert("L")


def beside(pictures: list[Image.Image], scale: float) -> Image.Image:
    """Pictures in a row, top sides aligned, reduced by ``scale``."""
    smaller = [
        picture.resize((round(picture.width * scale), round(picture.height * scale)), Image.Resampling.LANCZOS)
        for picture in pictures
    ]
    width = sum(picture.width + GAP for picture in smaller) - GAP
    row = Image.new("L", (width, max(picture.height for picture in smaller)), 255)
    left = 0
    for picture in smaller:
        row.paste(picture, (left, 0))
        left += picture.width + GAP
    return row


def features(picture: Image.Image, detector: str) -> Image.Image:
    """The features that a detector's contours become."""
    grey = np.asarray(picture, np.float32)[..., None] / 255
    exemplar = Exemplar(np.asarray(linear_from_srgb(grey), np.float32), ("Y",))
    strength = edges(exemplar, EdgesParams.model_validate({"detector": detector})).strength
    return Image.fromarray(otsu(strength, OtsuParams()).structure.astype(np.uint8) * 255)


def contours() -> Image.Image:
    """An exemplar and its features by both detectors: gravel as it is, and at half its resolution."""
    whole = exemplar("skimage:gravel")
    low = whole.resize((256, 256), Image.Resampling.BOX)
    rows = []
    for picture in (whole, low):
        shown = [picture, features(picture, "structured"), features(picture, "gradient")]
        corner = (0, 0, picture.width // 2, picture.height // 2)
        rows.append(beside([part.crop(corner).resize((512, 512), Image.Resampling.NEAREST) for part in shown], 0.5))
    both = Image.new("L", (rows[0].width, 2 * rows[0].height + GAP), 255)
    both.paste(rows[0], (0, 0))
    both.paste(rows[1], (0, rows[0].height + GAP))
    return both


def main() -> None:
    """Write the pictures."""
    PICTURES.mkdir(exist_ok=True)
    contours().save(PICTURES / "contours.jpg", quality=82)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        made = []
        for name in ("skimage:gravel", "skimage:grass"):
            made += [exemplar(name), synthesise(folder, "self_tuning", "--source", f"exemplar={name}")]
        beside(made, 0.5).save(PICTURES / "textures.jpg", quality=82)

        size = ("--set", "start.size=[768,1024]")
        plain, tuned = (synthesise(folder, flow, *size) for flow in ("texture_optimisation", "self_tuning"))
        beside([exemplar("skimage:brick"), plain, tuned], 0.6).save(PICTURES / "comparison.jpg", quality=82)

        tile = synthesise(
            folder, "self_tuning", "--source", "exemplar=skimage:gravel",
            "--set", "start.size=[384,384]", "--set", "texture.tileable=true",
        )  # fmt: skip
        repeated = Image.new("L", (3 * tile.width, 2 * tile.height))
        for row in range(2):
            for column in range(3):
                repeated.paste(tile, (column * tile.width, row * tile.height))
        beside([tile, repeated], 0.75).save(PICTURES / "tileable.jpg", quality=82)


if __name__ == "__main__":
    main()
