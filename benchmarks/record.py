"""The pixels of fifteen runs as digests, one line for every array that a step returns.

    python -m benchmarks.record > record.txt
    python -m benchmarks.record --against OTHER/.venv/bin/python

The second form runs those flows also with the texloom that another interpreter imports, as that of a clone of an
earlier commit, on the same machine, prints only the lines that differ, and exits with 1 if there are any. Digests
are of names, shapes, types and values of the channels in the stored EXR files, not of their headers, so that they
stay when what is written beside the pixels changes. Exemplars are crops of pictures that come with scikit-image.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

CONTROLLED = "gravel.png --source control=levels.png --source target=fields.png --seed 3"
RUNS = {
    "self_tuning": "self_tuning gravel.png --size 192 --seed 3",
    "self_tuning, tileable": "self_tuning brick.png --size 160 --tileable --seed 5",
    "self_tuning, guides": "self_tuning brick.png --size 128 --seed 1"
    " --source exemplar_guide=levels.png --source target_guide=fields.png",
    "self_tuning, mask": "self_tuning gravel.png --source mask=fields.png --size 128 --seed 2",
    "materials": "materials maps --size 128 --seed 4",
    "near_regular": "near_regular brick.png --size 160 --seed 3",
    "regularised_patches": "regularised_patches brick.png --size 160 --seed 3",
    "quilting": "quilting gravel.png --size 192 --seed 3",
    "graph_cut": "graph_cut grass.png --size 160 --seed 3",
    "per_pixel": "per_pixel grass.png --size 160 --seed 3",
    "image_melding": "image_melding gravel.png --size 128 --seed 3",
    "resynthesise": f"resynthesise {CONTROLLED}",
    "inverse_reconstruct": f"inverse_reconstruct {CONTROLLED}",
    "photo_to_texture": "photo_to_texture --size 128 --seed 3",
    "make_tileable": "make_tileable gravel.png --seed 3",
}


def make_sources(folder: Path) -> None:
    """Write the exemplars, a guide in two levels, a mask or target of fields, and a folder of maps."""
    import skimage.data
    from PIL import Image

    def write(name: str, pixels: np.ndarray) -> None:
        Image.fromarray(pixels).save(folder / name)

    crops = {name: getattr(skimage.data, name)()[100:260, 60:220] for name in ("brick", "gravel", "grass")}
    for name, crop in crops.items():
        write(f"{name}.png", crop)
    rows, columns = np.mgrid[:160, :160]
    write("fields.png", np.where((rows // 40 + columns // 53) % 2, 255, 0).astype(np.uint8))
    write("levels.png", np.where(columns < 80, 255, 0).astype(np.uint8))
    (folder / "maps").mkdir()
    brick = crops["brick"]
    slope = [np.roll(brick, 1, axis).astype(int) - np.roll(brick, -1, axis) for axis in (1, 0)]
    normal = np.stack([128 + slope[0] // 4, 128 - slope[1] // 4, np.full_like(slope[0], 240)], axis=2)
    write("maps/wall_albedo.png", np.repeat(brick[..., None], 3, axis=2))
    write("maps/wall_height.png", brick)
    write("maps/wall_normal.png", normal.astype(np.uint8))


def digests(interpreter: str, sources: Path, **environment: str) -> dict[str, str]:
    """Digest by run, step, output and layer, as the texloom of an interpreter computes them in an environment."""
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        for label, words in RUNS.items():
            command = [interpreter, "-P", "-m", "texloom", "run", *words.split(), "--json"]
            command += ["--store", f"{folder}/store", "--out", f"{folder}/{label}"]
            done = subprocess.run(
                command, cwd=sources, check=False, capture_output=True, text=True, env=os.environ | environment
            )
            if done.returncode:
                raise SystemExit(f"{label}: exit code {done.returncode}\n{done.stderr}")
            for step in json.loads(done.stdout)["steps"]:
                if step["state"] == "skipped":
                    continue
                result = Path(folder, "store", "cache", step["stage"], step["key"], "result.exr")
                for layer, digest in layers(result).items():
                    found[f"{label}: {step['name']}.{layer}"] = digest
    return found


def layers(file: Path) -> dict[str, str]:
    """Digest of each part of an EXR file, if there is one."""
    import OpenEXR

    found = {}
    if file.exists():
        with OpenEXR.File(str(file), separate_channels=True) as opened:
            for part in opened.parts:
                digest = hashlib.sha256()
                for name, channel in sorted(part.channels.items()):
                    pixels = np.ascontiguousarray(channel.pixels)
                    digest.update(f"{name} {pixels.dtype.str} {pixels.shape} ".encode())
                    digest.update(pixels.tobytes())
                found[part.name()] = digest.hexdigest()[:16]
    return found


def main() -> None:
    """Read the options; print all digests, or those that differ."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--against", metavar="PYTHON", help="interpreter of another environment to compare with")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        make_sources(Path(folder))
        here = digests(sys.executable, Path(folder))
        there = {} if options.against is None else digests(options.against, Path(folder))
    if options.against is None:
        print("\n".join(f"{digest}  {name}" for name, digest in here.items()))
        return
    differing = [name for name in {**there, **here} if here.get(name) != there.get(name)]
    for name in differing:
        print(f"{there.get(name, 'absent'):16} -> {here.get(name, 'absent'):16}  {name}")
    print(f"{len(differing)} of {len({**there, **here})} arrays differ")
    sys.exit(bool(differing))


if __name__ == "__main__":
    main()
