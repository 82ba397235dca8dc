"""Layouts of materials, written and read back; and register of their maps in a small synthesis.

    python -m benchmarks.layouts

writes one synthetic material in each layout with the bits of the layout and with 16, whole and as UDIM tiles, in
two resolutions, with and without what texloom says in its files, and reads it back: an error is a map that is
missing or wrong by more than its bits' rounding. Then it synthesises from each layout's folder, writes the result
in the layout, reads that, and prints the correlation of the gradients of colour and height (of roughness where a
layout has no height) relative to the exemplar's. The exit code is 1 where an error is left, or a ratio below .95.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import tempfile
from pathlib import Path

import cv2
import numpy as np

from tests.synthetic import blobs, smooth_noise
from texloom.pipelines.media.conventions import COLORS, LAYOUTS, ROLES, role_of
from texloom.pipelines.media.delivery import LAYOUTS as WRITTEN
from texloom.pipelines.media.delivery import SAME, Delivery
from texloom.pipelines.media.material_export import channels_of
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.media.writers.layouts import with_bits, write_layout
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, srgb_from_linear
from texloom.stages.vocabulary.normals import NORMAL, unit

SIZES = ((128, 128), (96, 144))
SMALL, RESULT = (80, 80), (112, 112)
"""px, of the exemplar of a synthesis and its result"""
LEAST = 0.95
_DATA = [role for role in ROLES if role not in (*COLORS, "normal", "mask", "height")]


def material(height: int, width: int) -> Image:
    """Stones: every map follows the heights, with noise of its own; green up."""
    rng = np.random.default_rng(7)
    relief = blobs((height, width), rng, 4.0)
    down, across = np.gradient(relief)
    normals = unit(np.dstack([-across, down, np.full_like(down, 0.15)]).astype(np.float32))

    def map_of(sign: float) -> np.ndarray:
        return np.clip(0.5 + sign * (0.7 * relief - 0.35) + 0.1 * (smooth_noise(relief.shape, 1, rng) - 0.5), 0, 1)

    colors = {role: np.dstack([map_of(sign) for sign in (1.0, 0.8, 0.6)]) for role in COLORS}
    planes = [colors["albedo"], normals, relief, *(map_of(-1 if role == "roughness" else 1) for role in _DATA)]
    names = ["R", "G", "B", *NORMAL, "height", *_DATA]
    for role in COLORS[1:]:
        planes.append(colors[role])
        names += [f"{role}.{letter}" for letter in "RGB"]
    return Image(np.dstack(planes).astype(np.float32), tuple(names))


def opened(folder: Path, is_silent: bool) -> Source:
    """What is read of a folder; ``is_silent``: after all that texloom says in PNGs is gone."""
    for path in folder.glob("*.png") if is_silent else ():
        values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert values is not None
        assert cv2.imwrite(str(path), values)
    return open_source("exemplar", str(folder))


def errors_of(source: Source, wanted: Image, name: str, fed: dict[str, int]) -> list[str]:
    """The maps that were read otherwise than they were written."""
    layout, found = LAYOUTS[name], source.read()
    parts = [with_bits(part, fed) for part in layout.written]
    bits = {role_of(plane)[0]: part.bits for part in parts for plane in part.planes if plane}
    bits = {role: own for role, own in bits.items() if channels_of(role, wanted.channels)}
    read = {one.role for one in source.maps}
    errors = [f"{role} not read" for role in sorted(set(bits) - read)]
    errors += [f"{role} read" for role in sorted(read - set(bits))]
    for role in sorted(read & set(bits)):
        names = channels_of(role, wanted.channels)
        was, is_now = (one.pixels[..., [one.channels.index(each) for each in names]] for one in (wanted, found))
        if role in COLORS and layout.kind == "png":
            was, is_now = srgb_from_linear(was), srgb_from_linear(is_now)
        levels = 2 ** bits[role] - 1 if layout.kind == "png" else 2**10
        worst = float(np.abs(is_now - was).max() * levels)
        if worst > (1.2 if role == "normal" else 0.51):
            errors.append(f"{role} wrong by {worst:.3g} levels")
        if layout.kind == "png" and source.map_bits[role] < bits[role]:
            errors.append(f"{role} has {source.map_bits[role]} bits")
    return errors


def register(image: Image) -> float:
    """Correlation of the gradients of lightness and of height, or roughness."""
    light = lab_from_linear(image.color)[..., 0]
    relief = image.pixels[..., image.channels.index("height" if "height" in image.channels else "roughness")]
    slopes = [np.concatenate([np.diff(plane, axis=axis).ravel() for axis in (0, 1)]) for plane in (light, relief)]
    return abs(float(np.corrcoef(slopes)[0, 1]))


def synthesised(exemplar: Image) -> Image:
    """A larger, tileable texture of a material, quickly."""
    start = initialise(exemplar, InitialiseParams(size=RESULT), np.random.default_rng(1)).match
    params = OptimiseParams(preset="fast", tileable=True)
    return optimise(exemplar, start, params, np.random.default_rng(2)).image


def main() -> int:
    """Print the errors and the register of each layout; 1 where one is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layout", action="append", metavar="NAME", help="only this one; repeatable")
    names = parser.parse_args().layout or [name for name in WRITTEN if name != SAME]
    logging.disable(logging.WARNING)  # of maps that a layout has no file for
    errors, low = 0, []
    for name in names:
        if LAYOUTS[name].kind == "tx" and importlib.util.find_spec("OpenImageIO") is None:
            print(f"{name:15} skipped: needs OpenImageIO")
            continue
        with tempfile.TemporaryDirectory() as folder:
            forms, wrong = 0, []
            for size in SIZES:
                for deep in (False, True):
                    fed = dict.fromkeys(ROLES, 16 if deep else 8)
                    for udim in (None, (2, 2)):
                        for is_silent in (False, True):
                            place = Path(folder, f"form{forms}")
                            forms += 1
                            write_layout(material(*size), place, "moss", Delivery(name, udim=udim), {}, fed)
                            form = f"{size}{' deep' * deep}{' UDIM' * bool(udim)}{' silent' * is_silent}"
                            found = errors_of(opened(place, is_silent), material(*size), name, fed)
                            wrong += [f"{form}: {one}" for one in found]
            write_layout(material(*SMALL), Path(folder, "small"), "moss", Delivery(name), {})
            exemplar = open_source("exemplar", f"{folder}/small").read()
            write_layout(synthesised(exemplar), Path(folder, "made"), "moss", Delivery(name), {})
            result = open_source("exemplar", f"{folder}/made").read()
        ratio = register(result) / register(exemplar)
        low += [name] if ratio < LEAST else []
        errors += len(wrong)
        print(f"{name:15} {forms} forms, errors: {len(wrong)}; register {ratio:.3f} of the exemplar's", flush=True)
        for one in wrong:
            print(f"    {one}")
    print(f"errors: {errors}; register below {LEAST}: {', '.join(low) or 'none'}")
    return 1 if errors or low else 0


if __name__ == "__main__":
    raise SystemExit(main())
