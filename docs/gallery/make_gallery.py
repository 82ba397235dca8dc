"""Run every flow and write the gallery: ``python docs/gallery/make_gallery.py --originals FOLDER``.

FOLDER holds the exemplars that ``gallery.yaml`` names (``from``), as downloaded. Commands run in ``build/gallery``.
Each run has a store there; where it exists, only what has changed is computed, and its time stays. ``--only NAME``
(repeatable) runs some, and ``--page`` none; both write the whole page.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import skimage.data
import yaml
from PIL import Image, ImageDraw

from texloom.pipelines.flow.shipped import GROUPS

HERE = Path(__file__).parent
DOCS = HERE.parent
WORK = DOCS.parent / "build" / "gallery"
EXEMPLARS = DOCS.parent / "configs" / "exemplars"
TIMES = HERE / "times.json"
GAP, WIDTH, HEIGHT = 8, 760, 256  # px; between the pictures of a figure, and what a figure may measure
MATERIAL = ("albedo", "normal", "roughness", "height", "ao")


def main() -> None:
    """Run what is asked for and write figures and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--originals", type=Path, help="folder of the exemplars, as downloaded")
    parser.add_argument("--only", action="append", metavar="NAME", help="run this flow only")
    parser.add_argument("--page", action="store_true", help="run nothing, write the page")
    options = parser.parse_args()
    gallery = yaml.safe_load((HERE / "gallery.yaml").read_text())
    failed = [] if options.page else make(gallery, options)
    (DOCS / "gallery.md").write_text(page(gallery, read_times()))
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")


def make(gallery: dict[str, Any], options: argparse.Namespace) -> list[str]:
    """Run the flows, keep their times and draw the figures; the names of those that failed."""
    if options.originals:
        prepare(gallery["exemplars"], options.originals)
    flows = {flow.get("name", flow["flow"]): flow for group in gallery["groups"] for flow in group["flows"]}
    runs = {name: f"{flow['flow']} {flow['run']}" for name, flow in flows.items()} | gallery["more"]
    failed = []
    for name, line in runs.items():
        if options.only and name not in options.only:
            continue
        print(f"texloom run {line}", flush=True)
        code, seconds = run(name, line, flows.get(name, {}).get("store", name))
        if code:
            failed.append(name)
        elif name in flows:
            if name == "inverse":
                retouch(WORK / "runs" / name)
            if seconds is not None:
                times = read_times() | {name: round(seconds, 1)}
                TIMES.write_text(json.dumps(times, indent=2, sort_keys=True) + "\n")
            if "figure" not in flows[name]:
                continue
            rows = [[picture.replace("out/", f"runs/{name}/") for picture in flows[name]["figure"]]]
            draw(rows, DOCS / "pictures" / "gallery" / f"{name}.webp", WIDTH, HEIGHT)
    if not options.only:
        for name, rows in gallery["figures"].items():
            draw(rows, DOCS / "pictures" / f"{name}.webp", WIDTH, 400)
    return failed


def read_times() -> dict[str, float]:
    """Flow to processor seconds."""
    return dict(json.loads(TIMES.read_text())) if TIMES.exists() else {}


# -- the exemplars


def prepare(exemplars: dict[str, dict[str, Any]], originals: Path) -> None:
    """Crop the originals, and draw the masks and control maps that go with them."""
    pictures = WORK / "exemplars"
    for name, exemplar in exemplars.items():
        source, target = originals / exemplar["from"], pictures / name
        files = (
            [(file, target / f"{kind}.png") for kind in MATERIAL for file in source.glob(f"{kind}.*")]
            if source.is_dir()
            else [(source, target)]
        )
        for file, made in files:
            made.parent.mkdir(parents=True, exist_ok=True)
            size, crop = exemplar["size"], exemplar["crop"]
            top, left = exemplar.get("at", (0, 0))
            reduced = Image.open(file).resize((size, size), Image.Resampling.LANCZOS)
            reduced.crop((left, top, left + crop, top + crop)).save(made)

    holes = Image.new("L", Image.open(pictures / "moss.png").size)
    drawing = ImageDraw.Draw(holes)
    drawing.ellipse((30, 150, 110, 215), fill=255)
    drawing.line((140, 30, 235, 120), fill=255, width=14)
    holes.save(pictures / "holes.png")

    spoiled = Image.open(pictures / "wall.png").convert("RGB")
    ImageDraw.Draw(spoiled).text((126, 142), "SAMPLE", fill="white", font_size=22)
    spoiled.save(pictures / "spoiled.png")
    spot = Image.new("L", spoiled.size)
    ImageDraw.Draw(spot).rectangle((120, 138, 232, 172), fill=255)
    spot.save(pictures / "spot.png")

    labelled = Image.open(pictures / "cracks.png").convert("RGB")
    ImageDraw.Draw(labelled).text((112, 196), "SAMPLE", fill="white", font_size=36)
    labelled.save(pictures / "labelled.png")
    mask = Image.new("L", (256, 256), 255)
    ImageDraw.Draw(mask).rectangle((106, 192, 255, 240), fill=0)
    mask.save(pictures / "mask.png")

    stones = Image.open(pictures / "stones.png").convert("RGBA")
    collage = Image.new("RGBA", (320, 320))
    for box, angle, at in (
        ((0, 0, 180, 170), 0, (-6, -4)),
        ((90, 60, 256, 230), 12, (160, -20)),
        ((20, 90, 190, 256), -18, (-30, 150)),
        ((70, 20, 250, 180), 0, (150, 170)),
    ):
        piece = stones.crop(box).rotate(angle, Image.Resampling.BICUBIC, expand=True)
        collage.paste(piece, at, piece)
    collage.save(pictures / "collage.png")

    strokes = Image.new("L", (384, 384), 0)
    for radius in range(40, 300, 50):
        ImageDraw.Draw(strokes).circle((192, 192), radius, outline=255, width=3)
    strokes.save(pictures / "strokes.png")

    row, column = np.mgrid[:256, :256] / 256
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * (2.5 * column + 0.35 * np.sin(2 * np.pi * row)))
    Image.fromarray(np.uint8(255 * (wave > 0.45))).save(pictures / "target.png")
    distance = np.hypot(row - 0.55, column - 0.4) + 0.02 * np.sin(4 * np.pi * row)
    bends = 0.5 + 0.5 * np.cos(12 * np.pi * distance)
    Image.fromarray(np.uint8(255 * bends)).save(pictures / "bends.png")

    spread(pictures)
    light(WORK / "lights")
    library, rust = WORK / "library", WORK / "rust"
    library.mkdir(exist_ok=True)
    for name in ("cracks.png", "moss.png", "planks.png"):
        shutil.copy(pictures / name, library)
    rust.mkdir(exist_ok=True)
    for name, kind in (("rust.png", "color"), ("rust_metallic.png", "control")):
        whole = Image.open(pictures / name)
        whole.crop((0, 0, 160, 160)).save(rust / f"left_{kind}.png")
        whole.crop((96, 96, 256, 256)).save(rust / f"right_{kind}.png")


def spread(pictures: Path) -> None:
    """Frames in which moss spreads over gravel, a map of where it begins, and a picture with more to the right."""
    moss = np.asarray(Image.open(pictures / "moss.png").convert("RGB"))
    gravel = np.asarray(Image.fromarray(skimage.data.gravel()).resize((256, 256)).convert("RGB"))
    row, column = np.mgrid[:256, :256] / 256
    early = 0.5 + 0.25 * (np.sin(2 * np.pi * (row + 0.5 * column)) + np.cos(2 * np.pi * (1.5 * column - 0.3 * row)))
    folder = WORK / "spreading"
    folder.mkdir(exist_ok=True)
    Image.fromarray(np.uint8(255 * early)).save(WORK / "spreading_control.png")
    for number in range(1, 13):
        # moss begins on what is dark
        age = number / 6 - (1 - early) - gravel.mean(axis=2) / 255
        share = np.clip(4 * age, 0, 1)[..., None]
        Image.fromarray(np.uint8((1 - share) * gravel + share * moss)).save(folder / f"moss_{number}.png")
    late = (gravel.mean(axis=2) / 255 + 0.5 * early).ravel().argsort(kind="stable").argsort(kind="stable")
    share = np.clip(8 * (1.3 * column - 0.2 - late.reshape(256, 256) / late.size), 0, 1)[..., None]
    Image.fromarray(np.uint8((1 - share) * gravel + share * moss)).save(pictures / "ageing.png")


def light(folder: Path) -> None:
    """Photographs of a wall under eight lights, and the file of their directions."""
    maps = EXEMPLARS / "brick_maps"
    albedo, normal = (
        np.asarray(Image.open(maps / f"bricks_{name}.png").convert("RGB")) / 255 for name in ("albedo", "normal")
    )
    turn, up = 2 * np.pi * np.arange(8) / 8 + 0.3, np.deg2rad(np.where(np.arange(8) % 2, 40, 60))
    towards = np.stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)], axis=1)
    folder.mkdir(exist_ok=True)
    for number, one in enumerate(towards, 1):
        shade = np.maximum((2 * normal - 1) @ one, 0)
        lit = (albedo**2.2 * shade[..., None]) ** (1 / 2.2)
        Image.fromarray(np.uint8(np.rint(255 * lit))).save(folder / f"{number}.png")
    (folder.parent / "lights.json").write_text(json.dumps({"lights": towards.round(4).tolist()}))


def retouch(folder: Path) -> None:
    """Paint the rust of a compaction blue, as a user would."""
    small = np.asarray(Image.open(folder / "texture.png").convert("RGB")).astype(int)
    is_rust = (small[..., 0] - small[..., 2] > 40)[..., None]
    Image.fromarray(np.uint8(np.where(is_rust, small[..., ::-1], small))).save(folder / "edited.png")


# -- the runs


def run(name: str, line: str, store: str) -> tuple[int, float | None]:
    """Run a command; its exit code, and its processor seconds unless it had a store of its own before."""
    program = shlex.quote(str(Path(sys.executable).with_name("texloom")))
    command = f"{program} run {line} --out runs/{name} --store stores/{store}"
    is_new = store != name or not (WORK / "stores" / name).exists()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "TEXLOOM_THREADS": "1"}
    done = subprocess.run(["/bin/bash", "-c", command], cwd=WORK, env=environment, check=False)  # noqa: S603
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        return done.returncode, None
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return 0, seconds if is_new else None


# -- figures and page


def draw(rows: list[list[str]], path: Path, width: int, height: int) -> None:
    """A figure: rows of pictures at one scale, no wider than ``width``, each row no higher than ``height``, px."""
    loaded = [[picture(name) for name in row] for row in rows]
    scale = min(
        1,
        *((width - GAP * (len(row) - 1)) / sum(each.width for each in row) for row in loaded),
        *(height / max(each.height for each in row) for row in loaded),
    )
    shown = [
        [
            each.resize((round(each.width * scale), round(each.height * scale)), Image.Resampling.LANCZOS)
            for each in row
        ]
        for row in loaded
    ]
    wide = max(sum(each.width + GAP for each in row) for row in shown) - GAP
    high = sum(max(each.height for each in row) + GAP for row in shown) - GAP
    figure = Image.new("RGB", (wide, high), "white")
    top = 0
    for row in shown:
        left = 0
        for each in row:
            figure.paste(each, (left, top))
            left += each.width + GAP
        top += max(each.height for each in row) + GAP
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.save(path, quality=65, method=6)


def picture(name: str) -> Image.Image:
    """A picture of a figure: a file of the work folder, texloom:NAME or skimage:NAME; ``2x`` repeats it."""
    twice = name.startswith("2x ")
    name = name.removeprefix("2x ")
    if name.startswith("skimage:"):
        one = Image.fromarray(getattr(skimage.data, name.removeprefix("skimage:"))())
    elif name.startswith("texloom:"):
        one = Image.open(EXEMPLARS / f"{name.removeprefix('texloom:')}.png")
    else:
        one = Image.open(WORK / name)
    if one.mode == "RGBA":
        one = Image.alpha_composite(Image.new("RGBA", one.size, "white"), one)
    if one.mode.startswith("I"):
        one = Image.fromarray(np.uint8(np.asarray(one, np.uint16) >> 8))
    one = one.convert("RGB")
    if not twice:
        return one
    tiled = Image.new("RGB", (2 * one.width, 2 * one.height))
    for left in (0, one.width):
        for top in (0, one.height):
            tiled.paste(one, (left, top))
    return tiled


HEAD = """\
<!-- Written by docs/gallery/make_gallery.py from docs/gallery/gallery.yaml. Edit those. -->

# Gallery

Every flow that ships with texloom, with the command that made its pictures. `--out FOLDER` chooses where results
are written, here `runs/FLOW`; by default a folder of the picture's and the flow's name.
`texloom flows NAME` lists the sources, parameters, steps and exports of a flow.

Times are processor seconds of one core for the whole command, start-up included, with compiled kernels and an empty
store. By default all cores are used. A second run takes what has not changed from the store.

"""

CREDITS = """\
## Exemplars

The originals are in the public domain (CC0). They were reduced to the given size and cropped.
`skimage:gravel`, `skimage:grass` and `skimage:coffee` (by Rachel Michetti) are CC0 too; `skimage:coins` (Brooklyn
Museum) has no known copyright restrictions. These four are installed with scikit-image.

| picture | original | reduced to | cropped to |
|---|---|---|---|
"""


def page(gallery: dict[str, Any], times: dict[str, float]) -> str:
    """The page in Markdown."""
    parts = [HEAD]
    for group in gallery["groups"]:
        parts.append(f"## {GROUPS[group['group']]}\n\n{group['text']}\n\n")
        for flow in group["flows"]:
            name = flow.get("name", flow["flow"])
            command = f"texloom run {flow['flow']} {flow['run']}".strip()
            seconds = f"{times[name]:.0f} s" if name in times else "not measured"
            figure = f"![{name}](pictures/gallery/{name}.webp)\n\n" if "figure" in flow else ""
            parts.append(f"### {name}\n\n{flow['use']}\n\n{figure}```bash\n{command}\n```\n\nTime: {seconds}.\n\n")
    rows = [
        f"| `exemplars/{name.rstrip('/')}` | {exemplar['credit']} | {exemplar['size']} x {exemplar['size']} | "
        f"{exemplar['crop']} x {exemplar['crop']} |\n"
        for name, exemplar in gallery["exemplars"].items()
    ]
    return "".join([*parts, CREDITS, *rows])


if __name__ == "__main__":
    main()
