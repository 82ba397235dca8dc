"""A running studio, and a browser with its page."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.conftest import ROOT
from tests.printed import next_line
from tests.runs import run_command
from texloom.pipelines.studio.built_page import BUILT

TEXLOOM = (sys.executable, "-m", "texloom")
FRUGAL = """
import multiprocessing
from texloom.pipelines.studio import processes, sessions
from texloom.__main__ import main
sessions.KEPT = 0
processes.Spares.prepare = lambda *_: None
if "forkserver" in multiprocessing.get_all_start_methods():
    studio = "texloom.pipelines.studio."
    multiprocessing.set_forkserver_preload([studio + "work_loop", studio + "previews", studio + "photographs"])
    get_context = multiprocessing.get_context
    multiprocessing.get_context = lambda _: get_context("forkserver")
main()
"""
"""texloom, but a page that is closed ends at once, and the next one takes its worker; none is prepared ahead, and
what all of them import is imported once"""
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT / ".import")}
SMALL = 64  # px of a side of the exemplar

# Without a GPU a lit material takes seconds to draw: for smooth edges, for the 256 samples a pixel that three.js
# takes of its surroundings, and for all pixels and corners, of which only some are drawn here.
ROUGH_SCENES = """{
  const { prototype: canvas } = HTMLCanvasElement, { prototype: gl } = WebGL2RenderingContext;
  const { getContext } = canvas, { shaderSource, viewport, drawElements } = gl;
  canvas.getContext = function (kind, options) {
    return getContext.call(this, kind, { ...options, antialias: false });
  };
  gl.shaderSource = function (shader, text) {
    shaderSource.call(this, shader, text.replace("GGX_SAMPLES 256u", "GGX_SAMPLES 4u"));
  };
  gl.viewport = function (x, y, width, height) {
    viewport.call(this, x, y, width / 4, height / 4);
  };
  gl.drawElements = function (mode, count, type, offset) {
    drawElements.call(this, mode, Math.min(count, 6000), type, offset);
  };
}"""


class Served:
    """A studio in a process of its own; as a context it ends it, at once where something has failed."""

    def __init__(self, folder: Path, store: Path, pages_are_kept: bool = False):
        command = TEXLOOM if pages_are_kept else (sys.executable, "-c", FRUGAL)
        self.process = subprocess.Popen(
            [*command, "studio", str(folder), "--no-browser", "--store", str(store)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT,
        )  # fmt: skip
        address = next_line(self.process).strip()
        found = re.fullmatch(r"(http://127\.0\.0\.1:(\d+))/\?code=\S+", address)
        if not found:
            self.process.kill()
        assert found, address + self.process.communicate()[0]
        self.base, self.port = found[1], int(found[2])
        with urllib.request.urlopen(address, timeout=120) as answer:
            self.cookie: str = answer.headers["set-cookie"].partition(";")[0]
        self.folder, self.store = folder, store

    def __enter__(self) -> Served:
        return self

    def __exit__(self, problem: type[BaseException] | None, *_: object) -> None:
        with self.process:
            if problem is None:
                self.end()
            self.process.kill()

    def end(self) -> None:
        """End it as a terminal does; it has to end in time, and well."""
        self.process.terminate()
        try:
            assert self.process.wait(60) == 0
        finally:
            self.process.kill()

    def new_address(self) -> str:
        """An address that opens the page in a browser; it is printed when the last one was opened."""
        return next_line(self.process).removeprefix("for another browser: ").strip()

    def let_in(self, context: Any) -> None:
        """Give a browser the cookie."""
        name, _, value = self.cookie.partition("=")
        context.add_cookies([{"name": name, "value": value, "url": self.base}])

    def request(
        self, path: str, data: Any = None, method: str | None = None, cookie: str | None = None, **headers: str
    ) -> tuple[int, bytes]:
        """Status and content of an answer; ``data`` is sent as JSON unless it is bytes."""
        body = data if data is None or isinstance(data, bytes) else json.dumps(data).encode()
        sent = {"Cookie": cookie if cookie is not None else self.cookie}
        sent |= {"Content-Type": "application/json"} | {
            name.replace("_", "-"): text for name, text in headers.items()
        }
        request = urllib.request.Request(self.base + path, body, sent, method=method)
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.read()

    def json(self, path: str, data: Any = None, method: str | None = None) -> Any:
        """The content of an answer that is no refusal."""
        status, content = self.request(path, data, method)
        assert status == 200, content
        return json.loads(content) if content else None

    def upload(self, files: dict[str, bytes], name: str = "") -> tuple[int, Any]:
        """Drop files."""
        key = self.json("/api/receiving", b"", "POST")
        for file, content in files.items():
            status, answer = self.request(f"/api/received/{key}/{file}", content, "PUT")
            if status != 200:
                return status, json.loads(answer)
        status, answer = self.request(f"/api/received/{key}?name={name}", b"", "POST")
        return status, json.loads(answer)


def exemplar() -> np.ndarray:
    """A picture of blotches, sRGB."""
    noise = np.random.default_rng(3).random((SMALL // 8, SMALL // 8, 3))
    image = PIL.Image.fromarray((255 * noise).astype(np.uint8))
    return np.asarray(image.resize((SMALL, SMALL), PIL.Image.Resampling.BICUBIC))


@pytest.fixture(scope="session")
def page() -> None:
    """Skip where the page has not been built."""
    if not (BUILT / "index.html").is_file():
        pytest.skip("the page of the studio is not built: `npm ci && npm run build` in pipelines/studio/client")


@pytest.fixture(scope="module")
def served(
    page: None, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Served]:
    """A studio of a folder with one picture; modules whose pages lose their sockets have ``PAGES_ARE_KEPT``."""
    root = tmp_path_factory.mktemp("studio")
    folder = root / "project"
    folder.mkdir()
    PIL.Image.fromarray(exemplar()).save(folder / "blotches.png")
    with Served(folder, root / "store", getattr(request.module, "PAGES_ARE_KEPT", False)) as studio:
        yield studio


class Watched:
    """A page whose console and requests are watched."""

    def __init__(self, page: Any, served: Served):
        self.page, self.served = page, served
        self.problems: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda message: message.type == "error" and self.problems.append(message.text))
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("websocket", lambda socket: self.requests.append(socket.url))
        page.set_default_timeout(180_000)  # kernels compile at first use
        served.let_in(page.context)
        served.json("/api/project/view", {"view": "make", "material": ""})  # not where an earlier page was
        page.goto(served.base)

    def check(self) -> None:
        """No error in the console, and no request to anywhere else."""
        assert self.problems == []
        own = (self.served.base, self.served.base.replace("http", "ws"), "data:", f"blob:{self.served.base}")
        assert [url for url in self.requests if not url.startswith(own)] == []


@contextlib.contextmanager
def watching(chromium: Any, served: Served, width: int, height: int, **options: Any) -> Iterator[Watched]:
    """A page in a window of its own of this size; its console and requests are checked at the end."""
    context = chromium.new_context(viewport={"width": width, "height": height}, **options)
    context.add_init_script(ROUGH_SCENES)
    watched = Watched(context.new_page(), served)
    yield watched
    watched.check()
    context.close()


@pytest.fixture
def watched(chromium: Any, served: Served) -> Iterator[Watched]:
    """A page at the size for which the studio is laid out."""
    with watching(chromium, served, 1280, 720, accept_downloads=True) as watched:
        yield watched


def draw_on(page: Any, picture: Path | str, layer: str) -> None:
    """Open a layer of a new material of a picture: one of the folder by its name, or a file that is dropped."""
    if (button := page.get_by_role("button", name="New material")).is_enabled():
        button.click()
    if isinstance(picture, str):
        page.locator("make-view").get_by_role("button", name=picture, exact=True).first.click()
    else:
        page.locator("make-view").get_by_label("Choose pictures").set_input_files(picture)
    if layer == "Surfaces":
        page.get_by_role("radio", name="A photograph").click()
        page.get_by_role("button", name="Place surfaces by hand").click()
        return
    page.locator("details[aria-label=Draw] > summary").locator("visible=true").click()
    page.get_by_role("radiogroup", name="Layer").locator("visible=true").get_by_role("radio", name=layer).click()


def resize(page: Any, width: int, height: int) -> None:
    """Give the size of the result in Make, px."""
    for side, length in (("Height", height), ("Width", width)):
        page.get_by_label(side).fill(str(length))
        page.get_by_label(side).press("Enter")


def run_again(arguments: list[str], folder: Path) -> Path:
    """Do what `texloom run` does, with a store of its own; the folder of its exports."""
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    run_command("run", *arguments, "--store", str(folder / "other"), "--out", str(out))
    return out


def repeated(panel: Any, folder: Path, finish: str = "Finish at full size") -> str:
    """Finish what a panel shows, and compare the result with those of flow file and command; the flow file."""
    page = panel.page
    with page.expect_response(lambda answer: "/api/jobs?" in answer.url):
        panel.get_by_role("button", name=finish).click()
    panel.get_by_text("Done in").wait_for()
    with page.expect_download() as picture:
        panel.get_by_role("link", name="texture.png").click()
    picture.value.save_as(folder / "texture.png")
    panel.get_by_role("button", name="Show as YAML or command").click()
    dialog = page.get_by_role("dialog", name="Flow file and command")
    command = shlex.split(dialog.locator("pre.command").inner_text())
    with page.expect_download() as saved:
        dialog.get_by_role("button", name=".yaml").click()
    flow = folder / saved.value.suggested_filename
    saved.value.save_as(flow)
    for arguments in ([str(flow)], command[2:]):
        out = run_again(arguments, folder)
        assert (folder / "texture.png").read_bytes() == (out / "texture.png").read_bytes()
    dialog.get_by_role("button", name="Close").click()
    return flow.read_text()
