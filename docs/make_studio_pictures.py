"""Take the pictures of docs/studio.md: ``python docs/make_studio_pictures.py --originals FOLDER``.

FOLDER holds the CC0 exemplars that docs/gallery/gallery.yaml names; a headless Chromium shows the studio with them.
"""

from __future__ import annotations

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import PIL.Image
import skimage
from playwright.sync_api import Locator, Page, sync_playwright

PICTURES = Path(__file__).parent / "pictures"
VIEWPORT = {"width": 1280, "height": 720}
CHROMIUM = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE_MS = 300_000


def begin(page: Page, title: str) -> None:
    """Begin a material with a picture of the folder, whichever material an earlier page has left open."""
    page.get_by_role("tab", name="Make").click()
    page.wait_for_timeout(1000)  # until that is open
    if (button := page.get_by_role("button", name="New material")).is_enabled():
        button.click()
    page.get_by_title(title).first.click()


def finish(page: Page, title: str) -> None:
    """Make a tileable texture of 256 px from a picture of the folder."""
    begin(page, title)
    page.get_by_role("button", name="256", exact=True).click()
    page.get_by_label("Preset").select_option("fast")
    page.get_by_label("Tileable").select_option("both")
    page.get_by_role("button", name="Finish at full size").click()
    page.get_by_label("Settings").get_by_text("Done in").wait_for()


def make(page: Page, shoot: Callable[[str], None]) -> None:
    """The preview of a tileable texture."""
    begin(page, "stones")
    page.get_by_label("Tileable").select_option("both")
    page.get_by_role("status").filter(has_text="full size").wait_for()  # nothing finer follows
    page.wait_for_timeout(1000)
    shoot("make")


def several(page: Page, shoot: Callable[[str], None]) -> None:
    """Two pictures in their order, and a way from the first to the second."""
    begin(page, "moss")
    page.get_by_label("Method").select_option("mix")
    page.get_by_title("stones").first.click()
    settings = page.get_by_label("Settings")
    settings.get_by_role("button", name="Paint map").click()
    settings.get_by_role("radio", name="Way").click()
    drag(settings.locator("map-painter"), 0, (0.1, 0.9), (0.2, 0.3), (0.5, 0.15), (0.8, 0.3), (0.9, 0.9))
    page.wait_for_timeout(1500)  # until the map has been sent
    page.get_by_role("status").filter(has_text="full size").wait_for()
    shoot("several")


def variants(page: Page, shoot: Callable[[str], None]) -> None:
    """What each method makes of a picture."""
    begin(page, "stones")
    page.get_by_role("button", name="512", exact=True).click()
    page.get_by_role("radio", name="Variants").click()
    page.get_by_role("radio", name="Methods").click()
    page.get_by_role("status").filter(has_text="Making").wait_for()
    page.get_by_role("status").filter(has_text="Making").wait_for(state="detached")
    shoot("variants")


def correct(page: Page, shoot: Callable[[str], None]) -> None:
    """Four versions of the worst place of a result."""
    finish(page, "stones")
    page.get_by_role("button", name="Correct a spot").click()
    page.get_by_label("Worst places").get_by_role("button").first.click()
    page.get_by_role("radio", name="Version 4").wait_for()
    page.get_by_role("radio", name="Version 2").click()
    shoot("correct")
    page.get_by_role("button", name="Cancel").click()


ELEMENTS = {"Guides": "paint", "Collage": "collage", "Lattice": "lattice"}


def draw_on(page: Page, picture: str, layer: str) -> None:
    """Open a layer of a picture of the folder."""
    begin(page, picture)
    page.locator("details[aria-label=Draw] > summary").locator("visible=true").click()
    page.get_by_role("radiogroup", name="Layer").locator("visible=true").get_by_role("radio", name=layer).click()


def directed(page: Page, picture: str, layer: str) -> Locator:
    """A layer that has a preview."""
    draw_on(page, picture, layer)
    shown = page.locator(f"direct-{ELEMENTS[layer]}")
    shown.locator("picture-view").first.wait_for()
    return shown


def drag(shown: Locator, view: int, *points: tuple[float, float]) -> None:
    """Drag over a picture, by shares of its own sides."""
    box = shown.locator("picture-view canvas").nth(view).bounding_box()
    assert box is not None
    side = min(box["width"], box["height"]) - 32
    left, top = box["x"] + (box["width"] - side) / 2, box["y"] + (box["height"] - side) / 2
    places = [(left + x * side, top + y * side) for x, y in points]
    shown.page.mouse.move(*places[0])
    shown.page.mouse.down()
    for place in places[1:]:
        shown.page.mouse.move(*place, steps=8)
    shown.page.mouse.up()


def followed(shown: Locator, shoot: Callable[[], None]) -> None:
    """Take the picture when the preview is there."""
    shown.page.wait_for_timeout(1000)  # until the last stroke has been sent
    shown.locator(".state", has_text="the full size has").wait_for()
    shown.page.mouse.move(640, 20)
    shoot()


def direct(page: Page, shoot: Callable[[str], None]) -> None:
    """Plaster and bare bricks as labels."""
    shown = directed(page, "plaster", "Guides")
    shown.get_by_role("radio", name="Areas").click()
    shown.get_by_label("Brush radius, px").fill("15")
    for stroke in (
        ((0.05, 0.55), (0.55, 0.55), (0.55, 0.66), (0.05, 0.66), (0.05, 0.72), (0.3, 0.72)),
        ((0.12, 0.05), (0.42, 0.06), (0.45, 0.14), (0.3, 0.12), (0.36, 0.28)),
        ((0.7, 0.2), (0.62, 0.42)),
        ((0.7, 0.05), (0.95, 0.1)),
        ((0.78, 0.86), (0.96, 0.9)),
        ((0.12, 0.93), (0.2, 0.93)),
    ):
        drag(shown, 0, *stroke)
    shown.get_by_label("Brush radius, px").fill("50")
    drag(shown, 1, (0.2, 0.25), (0.45, 0.6), (0.65, 0.3), (0.85, 0.75))
    shown.get_by_role("radio", name="Grey").click()
    for stroke in (((0.15, 0.75), (0.5, 0.9)), ((0.4, 0.15), (0.9, 0.1)), ((0.85, 0.3), (0.9, 0.4))):
        drag(shown, 1, *stroke)
    shown.get_by_label("Cover, %").fill("25")
    followed(shown, lambda: shoot("direct"))


def collage(page: Page, shoot: Callable[[str], None]) -> None:
    """Three pieces of a wall."""
    shown = directed(page, "stones", "Collage")
    shown.get_by_role("button", name="512", exact=True).click()
    for picked, to, angle in (
        (((0.05, 0.1), (0.4, 0.35)), (0.35, 0.3), 0),
        (((0.5, 0.05), (0.85, 0.4)), (0.72, 0.6), 25),
        (((0.1, 0.6), (0.4, 0.85)), (0.3, 0.78), -12),
    ):
        drag(shown, 0, *picked)
        for name, value in (("Row", to[1] * 512), ("Column", to[0] * 512), ("Angle", angle)):
            shown.get_by_label(name, exact=True).fill(str(round(value)))
            shown.get_by_label(name, exact=True).press("Enter")
    followed(shown, lambda: shoot("collage"))


def lattice(page: Page, shoot: Callable[[str], None]) -> None:
    """The lattice of a facade, with a vertex that is dragged."""
    shown = directed(page, "paving", "Lattice")
    shown.get_by_role("button", name="Detect").click()
    followed(shown, lambda: shoot("lattice"))


def paint(page: Page, shoot: Callable[[str], None]) -> None:
    """A stroke over a rusty plate."""
    draw_on(page, "rust", "Paint")
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


def photograph(page: Page, shoot: Callable[[str], None]) -> None:
    """A plane on a wall in perspective, with what lies in front of it."""
    begin(page, "wall")
    page.get_by_role("radio", name="A photograph").click()
    page.get_by_role("button", name="Place surfaces by hand").click()
    view = page.locator("photograph-view")
    view.get_by_role("button", name="Propose planes").click()
    view.get_by_role("button", name="Plane 1", exact=True).wait_for()
    view.get_by_role("radio", name="Control points").click()
    view.get_by_label("Streamlines").check()
    page.wait_for_function("() => document.querySelector('photograph-view').photo.streamlines !== null")
    page.mouse.move(640, 20)
    shoot("photograph")


def mesh(page: Page, shoot: Callable[[str], None]) -> None:
    """Bark along a line that is drawn around a torus."""
    draw_on(page, "bark", "Mesh")
    view = page.locator("mesh-view")
    page.wait_for_function("() => document.querySelector('mesh-view')?.corners")
    view.get_by_role("button", name="512").click()
    page.wait_for_function("() => document.querySelector('mesh-view').waits === ''")
    view.get_by_role("radio", name="Direction").click()
    box = view.locator("canvas.mesh").bounding_box()
    assert box is not None
    left, top = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(left - 230, top + 60)
    page.mouse.down()
    for right, down in ((-100, 120), (60, 130), (200, 70)):
        page.mouse.move(left + right, top + down, steps=8)
    page.mouse.up()
    view.get_by_role("button", name="Make the texture").click()
    view.get_by_text("Done in").wait_for()
    page.locator("mesh-view[ready]").wait_for()
    page.wait_for_timeout(2000)
    shoot("mesh")


def inspect(page: Page, shoot: Callable[[str], None]) -> None:
    """A material on a cloth."""
    finish(page, "bark")
    page.get_by_role("button", name="Inspect it").click()
    page.locator("inspect-view material-view[ready]").wait_for()
    page.locator("inspect-view").get_by_role("radio", name="Cloth").click()
    page.wait_for_timeout(2000)
    shoot("inspect")


def runs(page: Page, shoot: Callable[[str], None]) -> None:
    """The runs of the other pictures, and the steps of the last one."""
    page.get_by_role("tab", name="Runs").click()
    page.locator(".wall button").first.click()
    page.wait_for_timeout(2000)
    shoot("runs")


VIEWS = {
    "make": (make, "light"),
    "several": (several, "dark"),
    "variants": (variants, "light"),
    "correct": (correct, "dark"),
    "direct": (direct, "light"),
    "collage": (collage, "dark"),
    "lattice": (lattice, "light"),
    "paint": (paint, "light"),
    "photograph": (photograph, "dark"),
    "mesh": (mesh, "light"),
    "inspect": (inspect, "dark"),
    "runs": (runs, "light"),
}


def save(name: str, shot: bytes) -> None:
    """Keep a picture as soon as it is taken: all of them take several minutes."""
    with PIL.Image.open(io.BytesIO(shot)) as picture:
        picture.convert("RGB").save(PICTURES / f"studio_{name}.webp", quality=28, method=6)
    print(f"studio_{name}.webp", flush=True)


def main() -> None:
    """Start a studio and take one picture a view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--originals", type=Path, required=True)
    parser.add_argument("--only", nargs="+", choices=VIEWS, default=list(VIEWS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        library = Path(scratch) / "library"
        shutil.copytree(options.originals, library)
        PIL.Image.fromarray(skimage.data.brick()).save(library / "wall.png")  # CC0 too
        command = [sys.executable, "-m", "texloom", "studio", "library", "--no-browser", "--store", "store"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=scratch) as studio:  # noqa: S603
            assert studio.stdout is not None
            try:
                with sync_playwright() as playwright:
                    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM)
                    for name in options.only:
                        view, theme = VIEWS[name]
                        page = browser.new_page(viewport=VIEWPORT, color_scheme=theme)
                        page.set_default_timeout(PATIENCE_MS)
                        page.goto(studio.stdout.readline().strip().rpartition(" ")[2])  # another one each
                        view(page, lambda name, page=page: save(name, page.screenshot()))
                        page.close()
                    browser.close()
            finally:
                studio.terminate()


if __name__ == "__main__":
    main()
