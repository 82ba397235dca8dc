"""Writes one material in all layouts, for the programs that `.ci/hosts` opens it with.

python -m tests.hosts.write FOLDER
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks.layouts import material
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.delivery import LAYOUTS, SAME, Delivery
from texloom.pipelines.media.writers.layouts import material_name, write_layout
from texloom.stages.vocabulary.color import srgb_from_linear

SIDE = 64
NAMES = ("moss", material_name("Möß grün 苔 мох"))


def main(folder: Path) -> None:
    """One folder a material and layout, and ``expected.json``: what readers have to find.

    ``means`` of each channel as files have them, sRGB of colours; ``names`` of the materials, whose folders have
    their numbers, as some programs cannot open folders of any name.
    """
    image = material(SIDE, SIDE).wrapping(True)
    layouts = [name for name in LAYOUTS if name != SAME]
    if importlib.util.find_spec("OpenImageIO") is None:
        layouts.remove("arnold")
    for number, name in enumerate(NAMES):
        for layout in layouts:
            write_layout(image, folder / str(number) / layout, name, Delivery(layout, texel_size=0.001), {})
    encoded = {"R", "G", "B", *(f"{role}.{letter}" for role in COLORS for letter in "RGB")}
    means = {}
    for place, name in enumerate(image.channels):
        values = image.pixels[..., place]
        values = srgb_from_linear(values) if name in encoded else values
        means[name] = float(np.mean((values + 1) / 2 if name.startswith("normal.") else values))
    (folder / "expected.json").write_text(json.dumps({"means": means, "names": NAMES, "side": SIDE}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
