"""Photograph: what follows from patches and areas, and in a browser from a dropped photograph to the same bits."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.studio.conftest import Watched, draw_on, repeated
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import BrushRecipe, PatchRecipe, PhotoRecipe, Recipe
from texloom.pipelines.studio.messages.requests import PhotoRequest
from texloom.pipelines.studio.photographs import Photographer
from texloom.pipelines.studio.recipe_flows import described, open_recipe
from texloom.pipelines.studio.work import KeepPhotoWork, Places

CORNERS = ((500, 7), (10, 70), (10, 365), (500, 427))
WALL = PatchRecipe(name="wall", corners=CORNERS)
STROKE = BrushRecipe(tool="stroke", points=((100, 120), (200, 220)), radius=20)


class Asked:
    """A photographer, and what it has told."""

    def __init__(self, root: Path):
        self.places = Places(folder=str(root), store=str(root / "store"), scratch=str(root / "scratch"))
        self.photographer = Photographer(self.places)
        self.check: Callable[[], None] = lambda: None

    def __call__(self, recipe: PhotoRecipe, **asked: Any) -> dict[str, list[tuple[Any, bytes]]]:
        """The answers, by kind."""
        told: dict[str, list[tuple[Any, bytes]]] = {}

        def send(message: Message, payload: bytes = b"") -> None:
            told.setdefault(type(message).__name__, []).append((message, payload))

        request = PhotoRequest(number=1, recipe=recipe, **asked)
        self.photographer.answer(request, self.check, send)
        return told

    @property
    def sources(self) -> Path:
        """The folder of what the page has made."""
        return self.photographer.library.roots["dropped"]

    def keep(self, recipe: PhotoRecipe) -> Path:
        """The geometry file."""
        kept: list[Any] = []
        self.photographer.keep(KeepPhotoWork(recipe=recipe), kept.append)
        return Path(self.photographer.library.reference(kept[0].geometry))


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    return Asked(tmp_path_factory.mktemp("photographs"))


def recipe(**changes: Any) -> PhotoRecipe:
    return PhotoRecipe(photo="skimage:brick", **{"patches": (WALL,), **changes})


def test_a_patch_comes_with_its_grid_its_front_and_streamlines(asked: Asked) -> None:
    told = asked(recipe(), patch="wall", side=64, streamlines=True)
    ((state, _),) = told["PhotoState"]
    assert state.patches[0].problem == ""
    assert state.patches[0].rows[0] == 0
    assert state.patches[0].columns[-1] == pytest.approx(1)
    ((front, pixels),) = told["PhotoPreview"]
    assert max(front.height, front.width) == 64
    assert len(pixels) == 4 * front.height * front.width
    ((lines, points),) = told["PhotoLines"]
    assert np.frombuffer(points, np.float32).shape == (2 * lines.lines * lines.points * 2,)


def test_an_invalid_patch_says_why_and_the_others_wait(asked: Asked) -> None:
    crossed = PatchRecipe(name="crossed", corners=(CORNERS[1], CORNERS[0], *CORNERS[2:]))
    told = asked(recipe(patches=(WALL, crossed)), patch="wall", streamlines=True)
    assert set(told) == {"PhotoState"}
    problems = {one.name: one.problem for one in told["PhotoState"][0][0].patches}
    assert problems["wall"] == ""
    assert "crossed" in problems["crossed"]


def test_only_areas_that_change_are_sent(asked: Asked) -> None:
    asked(recipe())
    told = asked(recipe(areas={"without": (STROKE,)}))
    ((area, pixels),) = told["PhotoArea"]
    assert area.name == "without"
    assert 0 < np.count_nonzero(np.frombuffer(pixels, np.uint8)) < area.height * area.width / 2
    assert "PhotoArea" not in asked(recipe(areas={"without": (STROKE,)}))
    ((area, _),) = asked(recipe())["PhotoArea"]
    assert (area.name, area.height) == ("without", 0)


def test_a_region_that_is_erased_from_follows_the_patches(asked: Asked) -> None:
    erased = {"region": (STROKE.model_copy(update={"erase": True}),)}
    asked(recipe(areas=erased))
    moved = PatchRecipe(name="wall", corners=((300, 7), *CORNERS[1:3], (300, 427)))
    assert "PhotoArea" in asked(recipe(patches=(moved,), areas=erased))


def test_the_newest_request_does_not_wait_for_streamlines(asked: Asked) -> None:
    class NotWantedError(Exception):
        pass

    def stop() -> None:
        raise NotWantedError

    asked.check = stop
    with pytest.raises(NotWantedError):
        asked(recipe(), patch="wall", streamlines=True)
    asked.check = lambda: None


def test_the_geometry_file_has_patches_and_areas_and_is_the_same_again(asked: Asked) -> None:
    areas = {
        "without": (STROKE,),
        "hole": (BrushRecipe(tool="outline", points=((10, 90), (10, 120), (40, 100))),),
        "region": (BrushRecipe(tool="fill", points=((250, 250),), tolerance=30),),
        "features.joints": (BrushRecipe(tool="features", radius=12, tolerance=4, features="bright"),),
    }
    file = asked.keep(recipe(areas=areas))
    content = yaml.safe_load(file.read_text())
    assert content["patches"] == [{"name": "wall", "corners": [list(map(float, one)) for one in CORNERS]}]
    assert all((file.parent / name).is_file() for name in (content["hole"], content["features"]["joints"]))
    assert asked.keep(recipe(areas=areas)) == file
    assert not asked.photographer.library.pictures().pictures  # what was painted is no exemplar


@pytest.mark.parametrize("flow", ["photo_flattening", "photo_to_texture", "photo_completion", "photo_to_photo"])
def test_every_flow_takes_the_geometry_and_its_file_says_the_same(asked: Asked, flow: str, tmp_path: Path) -> None:
    hole = BrushRecipe(tool="outline", points=((200, 150), (200, 250), (280, 200)))
    geometry = f"dropped:{asked.keep(recipe(areas={'hole': (hole,)})).relative_to(asked.sources)}"
    scene = {"scene": "skimage:brick"} if flow == "photo_to_photo" else {}
    steps = ["surface.geometry", *(["place.geometry"] if scene else [])]
    sources = {"photo": "skimage:brick", **scene}
    made = Recipe(flow=flow, sources=sources, files=dict.fromkeys(steps, geometry), seed=3)
    library, store = asked.photographer.library, Store(Path(asked.places.store))
    run = open_recipe(made, library, store)
    told = described(made, run, library)
    (tmp_path / told.file).write_text(told.yaml)
    again = open_run(str(tmp_path / told.file), Overrides(), store)
    assert "refused" not in {one.state for one in run.plan()}
    assert {name: step.params for name, step in again.flow.steps.items()} == {
        name: step.params for name, step in run.flow.steps.items()
    }


def test_planes_are_proposed(asked: Asked) -> None:
    ((proposal, _),) = asked(PhotoRecipe(photo="skimage:brick"), propose=True)["PhotoProposal"]
    assert len(proposal.planes) == 1


def opened(watched: Watched, photograph: Path) -> Any:
    """The layer, with a plane on a dropped photograph."""
    draw_on(watched.page, photograph, "Surfaces")
    view = watched.page.locator("photograph-view")
    view.get_by_role("button", name="Add a plane").click()
    return view


def drag(view: Any, *points: tuple[float, float]) -> None:
    """Drag over the photograph, by shares of its side from its middle."""
    box, mouse = view.locator("photo-canvas canvas").bounding_box(), view.page.mouse
    side = min(box["width"], box["height"]) - 32
    places = [(box["x"] + box["width"] / 2 + x * side, box["y"] + box["height"] / 2 + y * side) for x, y in points]
    mouse.move(*places[0])
    mouse.down()
    for place in places[1:]:
        mouse.move(*place, steps=4)
    mouse.up()


def test_from_a_dropped_photograph_to_the_same_bits_in_a_terminal(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    view = opened(watched, watched.served.folder / "blotches.png")
    surfaces = page.get_by_label("Surfaces")
    corners = "() => document.querySelector('photograph-view').photo.undo.now.patches[0].corners"
    before = page.evaluate(corners)
    drag(view, (-0.25, -0.25), (-0.4, -0.45))
    assert page.evaluate(corners)[0][0] < before[0][0]
    page.keyboard.press("Control+z")
    assert page.evaluate(corners) == before
    drag(view, (0.25, 0.25), (-0.5, -0.3))
    surfaces.get_by_role("button", name="Plane 1 ⚠").wait_for()
    page.keyboard.press("Control+z")
    view.get_by_role("radio", name="Control points").click()
    drag(view, (-1 / 12, -1 / 12), (-0.15, -0.1))
    curved = surfaces.get_by_role("button", name="Plane 1, curved")
    curved.wait_for()
    page.keyboard.press("Control+z")
    curved.wait_for(state="detached")
    page.keyboard.press("Control+Shift+z")
    curved.wait_for()
    page.wait_for_function("() => document.querySelector('photograph-view').photo.front !== null")
    view.get_by_role("radio", name="Areas").click()
    view.get_by_role("radio", name="Without").click()
    surfaces.get_by_label("Brush radius").fill("2")
    drag(view, (0.1, 0.1), (0.15, 0.15))
    page.wait_for_function("() => document.querySelector('photograph-view').photo.areas.has('without')")
    view.get_by_role("radio", name="Make", exact=True).click()
    view.get_by_role("radio", name="Texture").click()
    surfaces.get_by_label("Size").fill("64")
    surfaces.get_by_label("Size").press("Enter")
    # on a machine that is busy, what the full size would take is told as too much, see `test_previews`
    view.get_by_text(re.compile("^Preview( at full size|; the full size has its own details)")).wait_for()
    view.locator("picture-view").wait_for()
    repeated(surfaces, tmp_path, "Make a texture")
    surfaces.get_by_role("button", name="Inspect it").click()
    page.locator("inspect-view material-view[ready]").wait_for()
