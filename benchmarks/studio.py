"""How soon the studio answers: ``python -m benchmarks.studio [--minutes 60]``.

Prints the weight of the page; the times from a request to the first and the last picture of a preview, of dragged
vertices, of dabs on a canvas of 1024x1024 px, of a moved patch on a photograph, and of tiles of a large layer, as
they arrive at the page; and the memory of all processes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from texloom.pipelines.store import exr
from texloom.pipelines.studio.messages import (
    Lattice,
    LatticeRequest,
    Message,
    PaintDabRequest,
    PaintOpenRequest,
    PatchRecipe,
    PhotoRecipe,
    PhotoRequest,
    PreviewRequest,
    Recipe,
    packed,
    unpacked,
)
from texloom.pipelines.studio.page import BUILT

EXEMPLAR = "texloom:bricks"
SIDE = 1024  # px of the canvas
DAB = 64  # px
PREVIEWS, DABS, DRAGS = 5, 50, 30
PHOTO = "skimage:brick"
LAYER = 8192  # px of a side of the layer that is looked at
TILE, TILES = 512, 20  # px; and how many are timed


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0, help="how long is painted for the memory")
    options = parser.parse_args()
    weigh()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "texloom", "studio", folder, "--no-browser", "--store", f"{folder}/store"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            base, _, token = server.stdout.readline().strip().partition("/?token=")
            try:
                with opened(base, token) as socket:
                    time_previews(socket)
                    time_lattices(socket)
                    time_dabs(socket, server.pid, options.minutes)
                    time_photographs(socket)
                time_tiles(base, token, Path(folder))
            finally:
                server.terminate()


def weigh() -> None:
    """Print the sizes of the page's files."""
    files = {path.name: path.stat().st_size for path in BUILT.iterdir() if path.suffix in (".html", ".css", ".js")}
    first = sum(size for name, size in files.items() if name.startswith(("index.", "studio.")))
    print(f"page: {sum(files.values()) / 1e3:.0f} kB, of which {first / 1e3:.0f} kB are loaded at the start")


def opened(base: str, token: str) -> Connection:
    """The socket of a page."""
    address = f"{base.replace('http', 'ws')}/api/socket"
    return connect(address, additional_headers={"Authorization": f"Bearer {token}"}, max_size=None, proxy=None)


def answers(socket: Connection, message: Message, payload: bytes = b"") -> Iterator[tuple[float, Any]]:
    """Seconds from a request to each of its answers, and the answer."""
    began = time.perf_counter()
    socket.send(packed(message, payload))
    number = json.loads(message.model_dump_json())["number"]
    while True:
        told = json.loads(unpacked(socket.recv(decode=False))[0])
        if told.get("number") == number:
            if told["kind"] == "preview_failed":
                raise RuntimeError(told["problem"])
            yield time.perf_counter() - began, told


def time_previews(socket: Connection) -> None:
    """Print the times of previews of one exemplar with several seeds; the first one also analyses the exemplar."""
    for seed in range(PREVIEWS):
        recipe = Recipe(flow="self_tuning", sources={"exemplar": EXEMPLAR}, size=(1024, 1024), seed=seed)
        first = None
        for seconds, told in answers(socket, PreviewRequest(number=seed, recipe=recipe)):
            first = seconds if first is None else first
            if told["is_final"]:
                print(f"preview {seed + 1}: first picture {first:.2f} s, last {seconds:.2f} s")
                break


def time_lattices(socket: Connection) -> None:
    """Print the time until a lattice one of whose vertices is dragged is there, with the straightened exemplar."""
    placed = Lattice(vertices=((0, 0, 100.0, 100.0),), generators=((60.0, 0.0), (0.0, 120.0)))
    seconds = []
    for step in range(DRAGS):
        moved = placed.model_copy(update={"vertices": (*placed.vertices, (1, 1, 160.0 + step % 10, 220.0))})
        request = LatticeRequest(number=5000 + step, picture=EXEMPLAR, lattice=moved)
        seconds.append(next(answers(socket, request))[0])
    rest = seconds[1:]  # the first one opens the picture
    print(f"vertex of a lattice: {spread(rest)}")


def time_dabs(socket: Connection, server: int, minutes: float) -> None:
    """Print the time of opening a canvas and of dabs, and the memory before and after painting for some time."""
    opening = PaintOpenRequest(number=1000, texture=EXEMPLAR, control="", size=(SIDE, SIDE))
    start = np.tile(np.linspace(0, 255, SIDE).astype(np.uint8), (SIDE, 1)).tobytes()
    opened_after = next(time for time, told in answers(socket, opening, start) if told["kind"] == "paint_picture")
    print(f"canvas of {SIDE}x{SIDE} px: {opened_after:.1f} s")
    rng = np.random.default_rng(1)
    seconds = [dab(socket, rng) for _ in range(DABS)]
    print(f"dab of {DAB}x{DAB} px: {spread(seconds)}")
    before, end = memory(server), time.monotonic() + 60 * minutes
    count = 0
    while time.monotonic() < end:
        dab(socket, rng)
        count += 1
    print(
        f"memory of all processes: {before:.0f} MB, after {count} dabs in {minutes:g} min {memory(server):.0f} MB"
    )


def time_photographs(socket: Connection) -> None:
    """Print the times from a moved control point to the grid, to the patch from the front and to streamlines."""
    times: dict[str, list[float]] = {"photo_state": [], "photo_preview": [], "photo_lines": []}
    for step in range(1 + DRAGS):
        corners = ((500 - step / 4, 7 + step / 4), (10, 70), (10, 365), (500, 427))
        patch = PatchRecipe(name="wall", corners=corners)
        recipe = PhotoRecipe(photo=PHOTO, patches=(patch,))
        request = PhotoRequest(number=3000 + step, recipe=recipe, patch="wall", side=320, streamlines=True)
        for seconds, told in answers(socket, request):
            if step:  # the first one reads the photograph
                times[told["kind"]].append(seconds)
            if told["kind"] == "photo_lines":
                break
    print(f"control point to grid: {spread(times['photo_state'])}")
    print(f"control point to patch from the front: {spread(times['photo_preview'])}")
    print(f"control point to streamlines: {spread(times['photo_lines'])}")


def time_tiles(base: str, token: str, folder: Path) -> None:
    """Print the times of the first look at a large layer, and of its tiles."""
    rng = np.random.default_rng(2)
    noise = np.tile(rng.random((1024, 1024)).astype(np.float16), (LAYER // 1024, LAYER // 1024))
    exr.write(folder / "large.exr", {"image": dict.fromkeys("RGB", noise)}, {}, "ZIP")
    key = json.loads(fetched(base, token, "/api/layers?item=folder:large.exr")[1])["key"]
    levels = int(np.ceil(np.log2(LAYER / TILE)))
    first = fetched(base, token, f"/api/tiles/{key}/0/{levels}/0/0")[0]
    print(f"layer of {LAYER}x{LAYER} px: overview {first:.1f} s")
    for level in (0, 1):
        places = rng.integers(LAYER // TILE >> level, size=(TILES, 2))
        seconds = [fetched(base, token, f"/api/tiles/{key}/0/{level}/{row}/{column}")[0] for row, column in places]
        print(f"tile of level {level}: {spread(seconds)}")


def fetched(base: str, token: str, path: str) -> tuple[float, bytes]:
    """Seconds that a request takes, and its answer."""
    began = time.perf_counter()
    request = urllib.request.Request(base + path, headers={"Authorization": f"Bearer {token}"})  # noqa: S310
    with urllib.request.urlopen(request) as answer:  # noqa: S310
        content: bytes = answer.read()
    return time.perf_counter() - began, content


def spread(seconds: list[float]) -> str:
    """Median and worst time."""
    return f"median {1e3 * np.median(seconds):.0f} ms, worst {1e3 * max(seconds):.0f} ms"


def dab(socket: Connection, rng: np.random.Generator) -> float:
    """Paint somewhere; seconds until the changed part is there."""
    top, left = (int(at) for at in rng.integers(SIDE - DAB, size=2))
    values = np.full((DAB, DAB), rng.integers(256), np.uint8).tobytes()
    request = PaintDabRequest(number=2000, top=top, left=left, height=DAB, width=DAB)
    return next(answers(socket, request, values))[0]


def memory(server: int) -> float:
    """Resident memory of a process and its children, MB."""
    children = Path(f"/proc/{server}/task/{server}/children").read_text().split()
    pages = (int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in [str(server), *children])
    return sum(pages) * 4096 / 1e6


if __name__ == "__main__":
    main()
