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
from texloom.pipelines.media.conventions import COLORS, ROLES
from texloom.pipelines.media.delivery import LAYOUTS, SAME, Delivery
from texloom.pipelines.media.writers.layouts import write_layout
from texloom.stages.vocabulary.color import srgb_from_linear

SIDE = 64


def main(folder: Path) -> None:
    """One folder a layout, and ``expected.json``: mean of each channel as files have them, sRGB of colours."""
    image = material(SIDE, SIDE).wrapping(True)
    for name in LAYOUTS:
        if name != SAME and (name != "arnold" or importlib.util.find_spec("OpenImageIO")):
            write_layout(image, folder / name, "moss", Delivery(name, texel_size=0.001), {})
    encoded = {"R", "G", "B", *(f"{role}.{letter}" for role in COLORS for letter in "RGB")}
    means = {}
    for place, name in enumerate(image.channels):
        values = image.pixels[..., place]
        values = srgb_from_linear(values) if name in encoded else values
        means[name] = float(np.mean((values + 1) / 2 if name.startswith("normal.") else values))
    (folder / "expected.json").write_text(json.dumps({"means": means, "roles": ROLES, "side": SIDE}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
