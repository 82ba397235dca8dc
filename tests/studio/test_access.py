"""The page without a mouse: by fingers, by keys, and by names that a screen reader tells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from tests.studio.conftest import Served, Watched, draw_on, watching

NAMELESS = """() => [...document.querySelectorAll("button, input, select, a, canvas, img")]
  .filter((one) => one.checkVisibility() && !one.closest("[aria-hidden=true]"))
  .filter((one) => one.tagName !== "IMG" || !one.hasAttribute("alt"))
  .filter((one) => !(one.ariaLabel || one.labels?.[0]?.innerText || one.innerText || one.title || "").trim())
  .map((one) => one.outerHTML)"""
TOO_WIDE = """() => [document.documentElement, ...document.querySelectorAll("aside")]
  .filter((one) => one.checkVisibility() && one.scrollWidth > one.clientWidth + 1).map((one) => one.ariaLabel)"""


@pytest.fixture
def touched(chromium: Any, served: Served) -> Iterator[Watched]:
    """A page under fingers."""
    with watching(chromium, served, 1280, 720, has_touch=True) as watched:
        yield watched


def masks(watched: Watched) -> Any:
    """Guides, with an exemplar whose mask is to be painted."""
    draw_on(watched.page, "blotches", "Guides")
    shown = watched.page.locator("direct-paint")
    shown.locator("picture-view").first.wait_for()
    return shown


def touch(page: Any, *moves: Sequence[tuple[float, float]]) -> None:
    """Put fingers down at the first places, move them to each of the others, and lift them."""
    session = page.context.new_cdp_session(page)
    for index, places in enumerate(moves):
        points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in enumerate(places)]
        kind = "touchMove" if index else "touchStart"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_one_finger_paints_and_two_zoom(touched: Watched) -> None:
    shown = masks(touched)
    canvas = shown.locator("picture-view canvas").first
    box, undo = canvas.bounding_box(), shown.get_by_role("button", name="Undo")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    scale = "canvas => canvas.parentElement.scale"
    before = canvas.evaluate(scale)
    touch(touched.page, [(x, y)], [(x, y), (x + 40, y)], [(x - 40, y), (x + 80, y)], [(x - 40, y), (x + 120, y)])
    assert canvas.evaluate(scale) > 1.5 * before
    assert undo.is_disabled()
    touch(touched.page, [(x, y)], [(x + 20, y + 5)], [(x + 40, y + 10)])
    undo.click()
    assert undo.is_disabled()


def test_a_finger_drags_a_corner_and_two_zoom(touched: Watched) -> None:
    page = touched.page
    draw_on(page, "blotches", "Surfaces")
    view = page.locator("photograph-view")
    view.get_by_role("button", name="Add a plane").click()
    canvas = view.locator("photo-canvas canvas")
    box = canvas.bounding_box()
    side = min(box["width"], box["height"]) - 32
    corner = (box["x"] + box["width"] / 2 - side / 4, box["y"] + box["height"] / 2 - side / 4)
    corners = "() => document.querySelector('photograph-view').photo.undo.now.patches[0].corners"
    before = page.evaluate(corners)
    touch(page, [corner], [(corner[0] - 20, corner[1] - 10)], [(corner[0] - 40, corner[1] - 20)])
    after = page.evaluate(corners)
    assert after[0][0] < before[0][0]
    assert after[1:] == before[1:]
    scale = "canvas => canvas.parentElement.scale"
    before = canvas.evaluate(scale)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2  # where the plane's handle is
    touch(page, [(x, y)], [(x, y), (x + 40, y)], [(x - 40, y), (x + 80, y)], [(x - 40, y), (x + 120, y)])
    assert canvas.evaluate(scale) > 1.5 * before
    assert page.evaluate(corners) == after


def test_a_finger_orders_pictures_and_draws_a_way(touched: Watched) -> None:
    page = touched.page
    page.get_by_role("button", name="blotches").first.tap()
    page.get_by_label("Method").select_option("mix")
    page.get_by_role("button", name="bricks").first.tap()
    listed = page.locator("several-pictures li")
    listed.nth(1).wait_for()
    page.get_by_role("button", name="Move bricks up").tap()
    page.get_by_text("bricks is number 1 of 2").wait_for(state="attached")
    assert listed.first.inner_text().split()[0] == "bricks"
    settings = page.get_by_label("Settings")
    settings.get_by_role("button", name="Paint map").tap()
    settings.get_by_role("radio", name="Way").tap()
    canvas = settings.locator("map-painter canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y, side = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, min(box["width"], box["height"])
    touch(page, [(x, y - 0.4 * side)], [(x, y)], [(x, y + 0.4 * side)])
    settings.get_by_label("Map", exact=True).locator("option", has_text="painted").wait_for(state="attached")
    first, last = page.evaluate("() => [0, -1].map((at) => document.querySelector('map-painter').map.codes.at(at))")
    assert first < 40 < 200 < last


def test_keys_paint(watched: Watched) -> None:
    shown, page = masks(watched), watched.page
    shown.locator("picture-view canvas").first.focus()
    page.keyboard.press("e")
    assert shown.get_by_role("radio", name="Eraser").get_attribute("aria-checked") == "true"
    page.keyboard.press("b")
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.down(" ")
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.up(" ")
    undo = shown.get_by_role("button", name="Undo")
    assert undo.is_enabled()
    page.keyboard.press("Control+z")
    assert undo.is_disabled()


def test_controls_of_methods_have_names_and_fit(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    settings = page.get_by_label("Settings")
    for method in ("remix", "mix", "grow", "restyle", "vary", "transition_tiles", "endless"):
        page.get_by_label("Method").select_option(method)
        page.wait_for_function(
            "flow => document.querySelector('make-view method-controls')?.method.flow === flow", arg=method
        )
        closed = settings.locator("details:not([open]) > summary")
        while closed.count():
            closed.first.click()
        for painted in settings.get_by_role("button", name="Paint ").all():
            painted.click()
        assert page.evaluate(NAMELESS) == [], method
        assert page.evaluate(TOO_WIDE) == [], method


def test_everything_has_a_name_and_fits(watched: Watched) -> None:
    page = watched.page
    for name in page.get_by_role("tab").all_inner_texts():
        page.get_by_role("tab", name=name).click()
        for picture in page.locator("main > :not([hidden])").get_by_role("button", name="blotches").all()[:1]:
            picture.click()
        assert page.evaluate(NAMELESS) == [], name
        assert page.evaluate(TOO_WIDE) == [], name
    page.get_by_role("tab", name="Make").click()
    draw_on(page, "blotches", "Guides")
    for layer in ("Guides", "Collage", "Lattice", "Paint", "Mesh", "Result"):
        layers = page.get_by_role("radiogroup", name="Layer").locator("visible=true")
        layers.get_by_role("radio", name=layer).click()
        assert page.evaluate(NAMELESS) == [], layer
        assert page.evaluate(TOO_WIDE) == [], layer


def test_a_narrow_window_shows_all(chromium: Any, served: Served) -> None:
    """Pictures, result and settings below each other; views are reached by scrolling their names."""
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    try:
        served.let_in(context)
        page = context.new_page()
        page.goto(served.base)
        for tab in page.get_by_role("tab").all():
            tab.click()
            assert page.evaluate("document.documentElement.scrollWidth") == 390
            stage = page.locator("main .stage").locator("visible=true").first.bounding_box()
            assert stage is not None
            assert stage["x"] >= 0
            assert 300 < stage["width"] <= 390
            assert stage["height"] > 300
    finally:
        context.close()
