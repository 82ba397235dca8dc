"""How soon the studio answers: ``python -m benchmarks.studio [--minutes 60]``.

Prints the weight of the page; the times from a request to the first and the last picture of a preview, also in
other tabs, of dragged vertices, of dabs on a canvas of 1024 x 1024 px, of a moved patch on a photograph, and of
tiles of a large layer and of an endless texture, as they arrive at the page; the memory of all processes while
somebody paints; and, with Playwright and a Chromium, the frames of the page while a control point is dragged. On a
machine with other work, times of the processor say more than those of the clock.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.studio.sockets import Page
from texloom.pipelines.store import exr
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import PatchRecipe, PhotoRecipe, Recipe
from texloom.pipelines.studio.messages.requests import (
    LatticeRequest,
    LatticeVertices,
    PaintDabRequest,
    PaintOpenRequest,
    PhotoRequest,
    PreviewRequest,
)
from texloom.pipelines.studio.page import BUILT
from texloom.pipelines.studio.processes import PAUSE

EXEMPLAR = "texloom:bricks"
SIDE = 1024  # px of the canvas
DAB = 64  # px
OTHER = "texloom:plaster"
PREVIEWS, DABS, DRAGS, TABS = 5, 50, 30, 3
IDLE = 0.02  # share of a processor below which nothing is being prepared
SCREEN = 900  # px, up to which previews get finer
REPORTS = 6  # of the memory
MOVES = 120  # of the pointer
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
            address = server.stdout.readline().strip()
            base = address.partition("/?")[0]
            with urllib.request.urlopen(address) as answer:  # noqa: S310
                cookie = answer.headers["set-cookie"].partition(";")[0]
            try:
                wait_until_idle(server.pid)
                with Page(base, cookie) as page:
                    time_previews(page, server.pid)
                    time_tabs(base, cookie, server.pid)
                    time_lattices(page)
                    time_dabs(page, server.pid, options.minutes)
                    time_photographs(page)
                    time_endless(base, cookie, page)
                time_tiles(base, cookie, Path(folder))
                time_frames(server.stdout.readline().strip().rpartition(" ")[2])
            finally:
                server.terminate()


def weigh() -> None:
    """Print the sizes of the page's files."""
    files = {path.name: path.stat().st_size for path in BUILT.iterdir() if path.suffix in (".html", ".css", ".js")}
    first = sum(size for name, size in files.items() if name.startswith(("index.", "studio.")))
    print(f"page: {sum(files.values()) / 1e3:.0f} kB, of which {first / 1e3:.0f} kB are loaded at the start")


def answers(page: Page, message: Message, payload: bytes = b"") -> Iterator[tuple[float, Any]]:
    """Seconds from a request to each of its answers, and the answer."""
    began = time.perf_counter()
    page.send(message, payload)
    number = json.loads(message.model_dump_json())["number"]
    for told, _ in page.messages():
        if told.get("number") == number:
            if told["kind"] == "preview_failed":
                raise RuntimeError(told["problem"])
            yield time.perf_counter() - began, told


def time_previews(page: Page, server: int) -> None:
    """Print the times of previews of one exemplar with several seeds; the first one also analyses the exemplar."""
    for seed in range(PREVIEWS):
        print(f"preview {seed + 1}: {preview(page, server, EXEMPLAR, seed)}")


def time_tabs(base: str, cookie: str, server: int) -> None:
    """Print the time of the first preview in other tabs, which are opened one after the other and stay open."""
    with contextlib.ExitStack() as tabs:
        for tab in range(TABS):
            wait_until_idle(server)
            told = preview(tabs.enter_context(Page(base, cookie)), server, OTHER, tab)
            print(f"tab {tab + 2}: {told}")
        wait_until_idle(server)
        print(f"memory of all processes with {TABS + 1} tabs: {memory(server):.0f} MB")


def preview(page: Page, server: int, exemplar: str, seed: int) -> str:
    """The times of a preview."""
    recipe = Recipe(flow="self_tuning", sources={"exemplar": exemplar}, size=(1024, 1024), seed=seed)
    before, first = processor(server), ""
    for seconds, told in answers(page, PreviewRequest(number=seed, recipe=recipe, largest=SCREEN)):
        first = first or f"first picture {seconds:.2f} s ({processor(server) - before:.2f} s of processors)"
        if told["done"] == 1:
            first += f", {told['width']} px {seconds:.2f} s"
        if told["is_final"]:
            return first
    raise AssertionError


def time_lattices(page: Page) -> None:
    """Print the time until a lattice one of whose vertices is dragged is there, with the straightened exemplar."""
    placed = LatticeVertices(vertices=((0, 0, 100.0, 100.0),), generators=((60.0, 0.0), (0.0, 120.0)))
    seconds = []
    for step in range(DRAGS):
        moved = placed.model_copy(update={"vertices": (*placed.vertices, (1, 1, 160.0 + step % 10, 220.0))})
        request = LatticeRequest(number=5000 + step, picture=EXEMPLAR, lattice=moved)
        seconds.append(next(answers(page, request))[0])
    rest = seconds[1:]  # the first one opens the picture
    print(f"vertex of a lattice: {spread(rest)}")


def time_dabs(page: Page, server: int, minutes: float) -> None:
    """Print the time of opening a canvas and of dabs, and the memory before and after painting for some time."""
    opening = PaintOpenRequest(number=1000, texture=EXEMPLAR, control="", size=(SIDE, SIDE))
    start = np.tile(np.linspace(0, 255, SIDE).astype(np.uint8), (SIDE, 1)).tobytes()
    opened_after = next(time for time, told in answers(page, opening, start) if told["kind"] == "paint_picture")
    print(f"canvas of {SIDE}x{SIDE} px: {opened_after:.1f} s")
    rng = np.random.default_rng(1)
    seconds = [dab(page, rng) for _ in range(DABS)]
    print(f"dab of {DAB}x{DAB} px: {spread(seconds)}")
    began, count = time.monotonic(), 0
    for part in range(REPORTS + 1):
        while time.monotonic() < began + 60 * minutes * part / REPORTS:
            dab(page, rng)
            count += 1
        told = f"{memory(server):.0f} MB after {count} dabs"
        print(f"memory of all processes: {told} in {minutes * part / REPORTS:.1f} min", flush=True)


def time_photographs(page: Page) -> None:
    """Print the times from a moved control point to the grid, to the patch from the front and to streamlines."""
    times: dict[str, list[float]] = {"photo_state": [], "photo_preview": [], "photo_lines": []}
    for step in range(1 + DRAGS):
        corners = ((500 - step / 4, 7 + step / 4), (10, 70), (10, 365), (500, 427))
        patch = PatchRecipe(name="wall", corners=corners)
        recipe = PhotoRecipe(photo=PHOTO, patches=(patch,))
        request = PhotoRequest(number=3000 + step, recipe=recipe, patch="wall", side=320, streamlines=True)
        for seconds, told in answers(page, request):
            if step:  # the first one reads the photograph
                times[told["kind"]].append(seconds)
            if told["kind"] == "photo_lines":
                break
    print(f"control point to grid: {spread(times['photo_state'])}")
    print(f"control point to patch from the front: {spread(times['photo_preview'])}")
    print(f"control point to streamlines: {spread(times['photo_lines'])}")


def time_tiles(base: str, cookie: str, folder: Path) -> None:
    """Print the times of the first look at a large layer, and of its tiles."""
    rng = np.random.default_rng(2)
    noise = np.tile(rng.random((1024, 1024)).astype(np.float16), (LAYER // 1024, LAYER // 1024))
    exr.write(folder / "large.exr", {"image": dict.fromkeys("RGB", noise)}, {}, "ZIP")
    key = json.loads(fetched(base, cookie, "/api/layers?item=folder:large.exr")[1])["key"]
    levels = int(np.ceil(np.log2(LAYER / TILE)))
    first = fetched(base, cookie, f"/api/tiles/{key}/0/{levels}/0/0")[0]
    print(f"layer of {LAYER}x{LAYER} px: overview {first:.1f} s")
    for level in (0, 1):
        places = rng.integers(LAYER // TILE >> level, size=(TILES, 2))
        seconds = [fetched(base, cookie, f"/api/tiles/{key}/0/{level}/{row}/{column}")[0] for row, column in places]
        print(f"tile of level {level}: {spread(seconds)}")


def time_endless(base: str, cookie: str, page: Page) -> None:
    """Print the times of tiles of an endless texture."""
    recipe = Recipe(flow="per_pixel", sources={"exemplar": EXEMPLAR}, size=(256, 256))
    job = json.loads(fetched(base, cookie, "/api/jobs", recipe.model_dump_json().encode())[1])["id"]
    for message, _ in page.messages():
        told = message.get("job", {})
        if told.get("id") == job and told["state"] not in ("waiting", "running"):
            break
    for level in (0, 1, 2):
        places = [(row, 100 * (level + 1) + column) for row in range(3) for column in range(3)]
        seconds = [fetched(base, cookie, f"/api/endless/{job}/{level}/{row}/{column}")[0] for row, column in places]
        print(f"tile of an endless texture, level {level}: {spread(seconds)}")


def time_frames(address: str) -> None:
    """Print the times between frames while a control point is dragged over a photograph, and what they cost."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if importlib.util.find_spec("playwright") is None or chromium is None:
        print("frames: not measured without Playwright and a Chromium")
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(120_000)
        page.goto(address)
        page.get_by_role("tab", name="Photograph").click()
        view = page.locator("photograph-view")
        view.get_by_role("button", name="bricks").first.click()
        view.get_by_role("button", name="Add a plane").click()
        view.get_by_role("radio", name="Control points").click()
        page.wait_for_function("() => document.querySelector('photograph-view').photo?.front")
        page.evaluate("""() => {
          window.times = [];
          const note = (now) => { window.times.push(now); requestAnimationFrame(note); };
          requestAnimationFrame(note);
        }""")
        box = view.locator("photo-canvas canvas").bounding_box()
        assert box is not None
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        grip = (min(box["width"], box["height"]) - 32) / 12  # to the inner control points
        tools = page.context.new_cdp_session(page)
        tools.send("Performance.enable", {"timeDomain": "threadTicks"})

        def busy() -> float:
            return next(
                float(one["value"])
                for one in tools.send("Performance.getMetrics")["metrics"]
                if one["name"] == "TaskDuration"
            )

        page.mouse.move(middle[0] - grip, middle[1] - grip)
        page.mouse.down()
        before, begun = busy(), page.evaluate("() => window.times.length")
        page.mouse.move(middle[0] - 2 * grip, middle[1] - 1.5 * grip, steps=MOVES)
        cost, times = busy() - before, page.evaluate("() => window.times")[begun:]
        page.mouse.up()
        frames = [now - then for then, now in itertools.pairwise(times)]
        print(f"frames while {MOVES} moves: {spread([one / 1e3 for one in frames])}", end="; ")
        print(f"{1e3 * cost / len(frames):.1f} ms of the page's processor time each")
        browser.close()


def fetched(base: str, cookie: str, path: str, content: bytes | None = None) -> tuple[float, bytes]:
    """Seconds that a request takes, and its answer."""
    began = time.perf_counter()
    headers = {"Cookie": cookie, "Content-Type": "application/json"}
    request = urllib.request.Request(base + path, content, headers)  # noqa: S310
    with urllib.request.urlopen(request) as answer:  # noqa: S310
        received: bytes = answer.read()
    return time.perf_counter() - began, received


def spread(seconds: list[float]) -> str:
    """Median and worst time."""
    return f"median {1e3 * np.median(seconds):.0f} ms, worst {1e3 * max(seconds):.0f} ms"


def dab(page: Page, rng: np.random.Generator) -> float:
    """Paint somewhere; seconds until the changed part is there."""
    top, left = (int(at) for at in rng.integers(SIDE - DAB, size=2))
    values = np.full((DAB, DAB), rng.integers(256), np.uint8).tobytes()
    request = PaintDabRequest(number=2000, top=top, left=left, height=DAB, width=DAB)
    return next(answers(page, request, values))[0]


def memory(server: int) -> float:
    """Resident memory of a process and its children, MB."""
    pages = (int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in processes(server))
    return sum(pages) * 4096 / 1e6


def processor(server: int) -> float:
    """Time of processors that a process and its children have used, s."""
    fields = (Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in processes(server))
    return sum(int(one[11]) + int(one[12]) for one in fields) / os.sysconf("SC_CLK_TCK")


def processes(server: int) -> list[str]:
    """A process and its children."""
    # those that any of its threads has started
    children = Path(f"/proc/{server}/task").glob("*/children")
    return [str(server), *(pid for path in children for pid in path.read_text().split())]


def wait_until_idle(server: int) -> None:
    """Wait until nothing is being prepared any more."""
    time.sleep(PAUSE + 2)  # until the next worker is begun
    before = processor(server)
    while True:
        time.sleep(2)
        now = processor(server)
        if now - before < 2 * IDLE:
            return
        before = now


if __name__ == "__main__":
    main()
