"""How closely `grow` follows the trend of exemplars that vary, and how like them its results are.

    TEXLOOM_TEXTURES=folder python -m benchmarks.growth
    TEXLOOM_TEXTURES=folder python -m benchmarks.growth --half 1 --keep results
    TEXLOOM_TEXTURES=folder python -m benchmarks.growth --set weight=2 --wide 2 1

Exemplars of at most 384 px a shorter side become three times as wide, by `grow` and by `self_tuning`, which evens.
Printed of each: the trend that was found, as share of the variance; for both flows the rank correlation of the
progression that is measured in the result with the one that was asked for, their mean difference, 0..1, the scores
fidelity, detail and structure, and the CPU seconds of a run. The progression of a result is that of the
exemplar's places that look like it in the slow feature of `progression`, in windows of the same size. Half 0 was
used to choose parameters, half 1 was not. Exemplars that are refused are named.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.stages.analysis.control.growth_guide import GrowthGuideParams, growth_guide
from texloom.stages.analysis.control.progression import ProgressionParams, progression
from texloom.stages.common.features.slow_features import progression_in, ranks
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError

_SIDE = 384  # px of an exemplar's shorter side
FILES = (
    "paint_patina_ns27_color.jpg",
    "earth_color.jpg",
    "palmtrunk_ns16_color.jpg",
    "mars_color.jpg",
    "rusty_metal053C_color.jpg",
    "mossy_rock053_color.jpg",
    "texbynum_coast_color.png",
    "spiral_basket_ns22_color.jpg",
    "brick_materialx_color.jpg",
)
"""every second one is of half 0"""
FLOWS = ("grow", "self_tuning")
SCORES = ("fidelity", "detail", "structure")


def write_reduced(picture: Path, file: Path) -> None:
    """Write a picture as PNG, at most `_SIDE` px a shorter side."""
    from PIL import Image as Pillow

    with Pillow.open(picture) as opened:
        image = opened.convert("RGB")
        factor = min(1.0, _SIDE / min(image.size))
        image.resize((round(image.width * factor), round(image.height * factor)), Pillow.Resampling.BOX).save(file)


def read(file: Path) -> Image:
    """A picture as texloom reads it."""
    return open_source("exemplar", str(file)).read()


def make(flow: str, exemplar: Path, size: tuple[int, int], folder: Path, words: list[str]) -> dict[str, float]:
    """Run a flow into a folder; its scores and CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-P", "-m", "texloom", "run", flow, str(exemplar), "--size", f"{size[1]}x{size[0]}",
         *words, "--store", str(folder / "store"), "--out", str(folder), "--force"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{exemplar.name}: exit code {done.returncode}\n{done.stderr}")
    scores = json.loads((folder / "scores.json").read_text())["summary"]
    return {
        **{name: scores[name] for name in SCORES},
        "CPU s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
    }


def compared(exemplar: Image, made: Image, wanted: ScalarMap) -> dict[str, float]:
    """How the progression that is measured in a result goes with the one that was asked for."""
    found = progression_in(made, exemplar)
    asked = resize(wanted[..., None], found.shape[0], found.shape[1], bilinear=True)[..., 0]
    return {
        "follows": float(np.corrcoef(ranks(found, None).ravel(), ranks(asked, None).ravel())[0, 1]),
        "off by": float(np.abs(found - asked).mean()),
    }


def main() -> None:
    """Read the options; make, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--half", type=int, choices=(0, 1), help="a half of them (default: all)")
    parser.add_argument("--textures", type=Path, default=os.environ.get("TEXLOOM_TEXTURES"), help="their folder")
    parser.add_argument("--wide", type=int, nargs=2, default=(3, 1), help="times the exemplar's width and height")
    parser.add_argument("--keep", type=Path, help="folder where results stay")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of `grow`")
    options = parser.parse_args()
    if options.textures is None:
        parser.error("name the folder of the pictures by --textures or TEXLOOM_TEXTURES")
    names = ("follows", "off by", *SCORES, "CPU s")
    print(f"{'':42}{'trend':>8}" + "".join(f"{name:>11}" for name in names))
    total: dict[str, list[dict[str, float]]] = {flow: [] for flow in FLOWS}
    with tempfile.TemporaryDirectory() as temporary:
        for number, name in enumerate(FILES):
            if options.half not in (None, number % 2):
                continue
            folder = (options.keep or Path(temporary)).resolve() / Path(name).stem
            folder.mkdir(parents=True, exist_ok=True)
            file = folder / name.replace(".jpg", ".png")
            write_reduced(options.textures / "globally_varying" / name, file)
            exemplar = read(file)
            try:
                trend = progression(exemplar, ProgressionParams())
            except InputError as error:
                print(f"{Path(name).stem[:28]:30}refused: {error}")
                continue
            size = exemplar.height * options.wide[1], exemplar.width * options.wide[0]
            guide = growth_guide(exemplar, trend.progression, trend.slow, GrowthGuideParams(size=size))
            for flow in FLOWS:
                words = [word for pair in options.set for word in ("--set", pair)] if flow == "grow" else []
                figures = make(flow, file, size, folder / flow, words)
                figures |= compared(exemplar, read(folder / flow / "texture.png"), guide.wanted)
                total[flow].append(figures)
                shown = "".join(f"{figures[name]:11.3f}" for name in names)
                print(f"{Path(name).stem[:28]:30}{flow:12}{trend.share:8.3f}{shown}", flush=True)
    for flow, rows in total.items():
        means = "".join(f"{np.mean([row[name] for row in rows]):11.3f}" for name in names)
        print(f"{'mean':30}{flow:12}{'':8}{means}")


if __name__ == "__main__":
    main()
