"""Take the pictures of docs/studio.md: ``python docs/make_studio_pictures.py --originals FOLDER``.

FOLDER holds the CC0 exemplars that docs/gallery/gallery.yaml names; a headless Chromium shows the studio with them.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import PIL.Image
from playwright.sync_api import Page, sync_playwright

PICTURES = Path(__file__).parent / "pictures"
VIEWPORT = {"width": 1280, "height": 720}
CHROMIUM = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE_MS = 100_000


def finish(page: Page, title: str) -> None:
    """Make a tileable texture of 256 px from a picture of the folder."""
    page.get_by_role("tab", name="Make").click()
    page.get_by_title(title).first.click()
    page.get_by_role("button", name="256", exact=True).click()
    page.get_by_label("Preset").select_option("fast")
    page.get_by_label("Tileable").check()
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()


def make(page: Page, shoot: Callable[[str], None]) -> None:
    """The preview of a tileable texture."""
    page.get_by_title("stones").first.click()
    page.get_by_label("Tileable").check()
    page.wait_for_function("() => document.querySelector('make-view').done === 1")
    page.wait_for_timeout(1000)
    shoot("make")


def correct(page: Page, shoot: Callable[[str], None]) -> None:
    """Four versions of the worst place of a result."""
    finish(page, "stones")
    page.get_by_role("button", name="Correct a spot").click()
    page.get_by_label("Worst places").get_by_role("button").first.click()
    page.get_by_role("radio", name="Version 4").wait_for()
    page.get_by_role("radio", name="Version 2").click()
    shoot("correct")
    page.get_by_role("button", name="Cancel").click()


def paint(page: Page, shoot: Callable[[str], None]) -> None:
    """A stroke over a rusty plate."""
    page.get_by_role("tab", name="Paint").click()
    page.get_by_label("Originals").get_by_title("rust").first.click()
    page.get_by_label("Control map").select_option("folder:rust_metallic.jpg")
    page.get_by_role("button", name="Begin to paint").click()
    page.get_by_text("Paint: the texture follows").wait_for()
    canvas = page.locator("canvas.result").bounding_box()
    assert canvas is not None
    page.get_by_label("Brush radius").fill("30")
    page.mouse.move(canvas["x"] + 120, canvas["y"] + 150)
    page.mouse.down()
    for step in range(40):
        page.mouse.move(canvas["x"] + 120 + 8 * step, canvas["y"] + 150 + 4 * abs(step % 20 - 10))
        page.wait_for_timeout(30)
    page.mouse.up()
    page.wait_for_timeout(2000)
    shoot("paint")


def inspect(page: Page, shoot: Callable[[str], None]) -> None:
    """A material on a cloth."""
    finish(page, "bark")
    page.get_by_role("button", name="Look at it in 3D").click()
    page.locator("material-view[ready]").wait_for()
    page.get_by_role("radio", name="Cloth").click()
    page.wait_for_timeout(2000)
    shoot("inspect")


def runs(page: Page, shoot: Callable[[str], None]) -> None:
    """The runs of the other pictures, and the steps of the last one."""
    page.get_by_role("tab", name="Runs").click()
    page.locator(".wall button").first.click()
    page.wait_for_timeout(2000)
    shoot("runs")


def main() -> None:
    """Start a studio and take one picture a view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--originals", type=Path, required=True)
    originals = parser.parse_args().originals
    with tempfile.TemporaryDirectory() as scratch:
        library = Path(scratch) / "library"
        shutil.copytree(originals, library)
        command = [sys.executable, "-m", "texloom", "studio", "library", "--no-browser", "--store", "store"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=scratch) as studio:  # noqa: S603
            assert studio.stdout is not None
            address = studio.stdout.readline().strip()
            try:
                with sync_playwright() as playwright:
                    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM)
                    for view, theme in (
                        (make, "light"),
                        (correct, "dark"),
                        (paint, "light"),
                        (inspect, "dark"),
                        (runs, "light"),
                    ):
                        page = browser.new_page(viewport=VIEWPORT, color_scheme=theme)
                        page.set_default_timeout(PATIENCE_MS)
                        page.goto(address)
                        view(page, lambda name, page=page: page.screenshot(path=f"{scratch}/studio_{name}.png"))
                        page.close()
                    browser.close()
            finally:
                studio.terminate()
        for shot in sorted(Path(scratch).glob("studio_*.png")):
            with PIL.Image.open(shot) as picture:
                picture.convert("RGB").save(PICTURES / f"{shot.stem}.webp", quality=80, method=6)


if __name__ == "__main__":
    main()
