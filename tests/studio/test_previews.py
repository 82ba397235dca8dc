"""Previews: how large their pictures are, and what the finest one shows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import texloom
from tests.studio.conftest import Served
from tests.studio.sockets import Page
from texloom.pipelines.studio.messages.answers import PreviewPicture
from texloom.pipelines.studio.messages.recipes import BrushRecipe, KeptPhoto, PatchRecipe, PhotoRecipe, Recipe
from texloom.pipelines.studio.messages.requests import PreviewRequest, PreviewStopRequest
from texloom.pipelines.studio.photographs import Photographer
from texloom.pipelines.studio.previews import Previewer
from texloom.pipelines.studio.reduced_recipes import Reduction, reduced_document
from texloom.pipelines.studio.work import KeepPhotoWork, Places

EXEMPLAR, RESULT = (512, 512), (1024, 1024)


def scales(size: tuple[int, int], largest: int, seconds_of_full: float) -> list[float]:
    """Those of all pictures of a preview, where the full size takes so long."""
    found: list[float] = []
    reduction: Reduction | None = Reduction.first(EXEMPLAR, size)
    while reduction is not None:
        found.append(reduction.scale)
        made = reduction.size(size)
        reduction = reduction.finer(size, largest, seconds_of_full * made[0] * made[1] / (size[0] * size[1]))
    return found


def test_the_first_picture_alone_is_made_without_a_screen() -> None:
    assert scales(RESULT, 0, 1.0) == [288 / 1024]


def test_pictures_get_finer_up_to_the_screen() -> None:
    assert scales((8192, 8192), 1024, 1e6) == pytest.approx([72 / 512, 2.56 * 72 / 512])  # of the part that is made
    first = 288 / 1024
    assert scales(RESULT, 900, 60.0) == pytest.approx([first, 2 * first, 900 / 1024])
    assert scales(RESULT, 500, 60.0) == pytest.approx([first, 500 / 1024])
    assert scales(RESULT, 200, 60.0) == [first]


def test_the_full_size_is_made_where_it_takes_seconds() -> None:
    first = 288 / 1024
    assert scales(RESULT, 900, 9.0) == pytest.approx([first, 2 * first, 1])
    assert scales(RESULT, 200, 9.0)[-1] == 1


def test_a_part_of_a_large_result_is_the_same_part_in_all_pictures() -> None:
    first = Reduction.first(EXEMPLAR, (8192, 4096))
    second = first.finer((8192, 4096), 1024, 100.0)
    assert second is not None
    for reduction in (first, second):
        assert np.array(reduction.size((8192, 4096))) / reduction.scale == pytest.approx(400 * 512 / 72, abs=8)


def test_all_of_what_a_small_exemplar_makes_follows_its_part() -> None:
    first = Reduction.first((64, 64), RESULT)
    assert first == Reduction(1.0, 400)
    assert first.finer(RESULT, 900, 1.0) == Reduction(1.0, 1024)
    assert first.finer(RESULT, 900, 2.0) is None
    assert Reduction(1.0, 1024).finer(RESULT, 900, 1.0) is None


def test_sides_of_the_full_size_are_kept() -> None:
    assert Reduction(1.0, 400).size((301, 299)) == (301, 299)
    assert Reduction(0.5, 400).size((301, 299)) == (152, 148)


def test_what_no_part_shows_is_made_whole() -> None:
    first = Reduction.first(EXEMPLAR, (2048, 2048), is_whole=True)
    assert first == Reduction(72 / 512, 2048)
    assert first.size((2048, 2048)) == (288, 288)
    assert Reduction.first(EXEMPLAR, RESULT, is_whole=True).size(RESULT) == (144, 144)


def test_lines_of_smaller_pictures_lie_at_the_same_shares() -> None:
    document = {"size": "64x32", "strokes": [[[-0.5, 63.5], [31.5, 15.5]]], "width": 3}
    assert reduced_document(document, 0.5) == {
        "size": "32x16",
        "strokes": [[[-0.5, 31.5], [15.5, 7.5]]],
        "width": 3,
    }


def test_the_finest_picture_of_a_mesh_is_its_texture(tmp_path: Path) -> None:
    """Along the lines that are drawn on it, which a smaller picture follows too."""
    places = Places(folder=f"{tmp_path}", store=f"{tmp_path}/store", scratch=f"{tmp_path}/scratch")
    PIL.Image.fromarray(np.random.default_rng(2).integers(0, 256, (160, 160, 3), np.uint8)).save(
        tmp_path / "noise.png"
    )
    lines = {"size": "160x160", "strokes": [[[30, 30], [60, 90], [120, 130]]], "width": 3}
    content = json.dumps(lines).encode()
    sources = {"exemplar": "folder:noise.png", "mesh": "texloom:torus", "strokes": "attached:strokes.json"}
    request = PreviewRequest(
        number=1, largest=400, attached={"strokes.json": len(content)},
        recipe=Recipe(flow="on_mesh", sources=sources, size=(160, 160), seed=5),
    )  # fmt: skip
    sent: list[tuple[PreviewPicture, bytes]] = []
    Previewer(places).make(request, content, lambda: None, lambda *told: sent.append(told))
    whole = [one for one, _ in sent if one.done == 1]
    assert [(one.height, one.is_final) for one in whole] == [(144, False), (160, True)]
    (tmp_path / "lines.json").write_bytes(content)
    given = {"exemplar": tmp_path / "noise.png", "mesh": "texloom:torus", "strokes": tmp_path / "lines.json"}
    texloom.run("on_mesh", given, size=160, seed=5, store=tmp_path / "store", out=tmp_path / "made")
    made = np.asarray(PIL.Image.open(tmp_path / "made/texture.png").convert("RGBA"))
    np.testing.assert_array_equal(np.frombuffer(sent[-1][1], np.uint8).reshape(160, 160, 4), made)


def test_the_finest_picture_of_a_surface_is_its_texture(tmp_path: Path) -> None:
    """Patches and painted areas follow the photograph that is reduced."""
    places = Places(folder=f"{tmp_path}", store=f"{tmp_path}/store", scratch=f"{tmp_path}/scratch")
    pixels = np.random.default_rng(2).integers(0, 256, (260, 300, 3), np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "noise.png")
    patch = PatchRecipe(name="wall", corners=((20, 20), (10, 280), (240, 250), (230, 40)))
    areas = {"without": (BrushRecipe(tool="stroke", points=((60, 60), (90, 60)), radius=9),)}
    photo = PhotoRecipe(photo="folder:noise.png", patches=(patch,), areas=areas)
    kept: list[KeptPhoto] = []
    Photographer(places).keep(KeepPhotoWork(recipe=photo), lambda one, *_: kept.append(one))
    recipe = Recipe(
        flow="photo_to_texture", sources={"photo": "folder:noise.png"}, size=(64, 64), tileable="both", seed=5,
        files={"surface.geometry": kept[0].geometry},
    )  # fmt: skip
    sent: list[tuple[PreviewPicture, bytes]] = []
    previewer = Previewer(places)
    request = PreviewRequest(number=1, recipe=recipe, largest=400)
    previewer.make(request, b"", lambda: None, lambda *told: sent.append(told))
    whole = [one for one, _ in sent if one.done == 1]
    assert [(one.scale, one.height, one.is_final) for one in whole] == [(0.8, 64, False), (1, 64, True)]
    geometry = previewer.library.reference(kept[0].geometry)
    given = {"size": 64, "tileable": "both", "seed": 5, "params": {"surface.geometry": geometry}}
    stored = {"store": tmp_path / "store", "out": tmp_path / "made"}
    texloom.run("photo_to_texture", {"photo": tmp_path / "noise.png"}, **given, **stored)
    made = np.asarray(PIL.Image.open(tmp_path / "made/texture.png").convert("RGBA"))
    np.testing.assert_array_equal(np.frombuffer(sent[-1][1], np.uint8).reshape(64, 64, 4), made)


def test_the_first_picture_of_a_flat_surface_needs_no_choice(tmp_path: Path) -> None:
    """Of two textures and their scores; one is made until a finer picture is wanted."""
    places = Places(folder=f"{tmp_path}", store=f"{tmp_path}/store", scratch=f"{tmp_path}/scratch")
    pixels = np.random.default_rng(2).integers(0, 256, (360, 400, 3), np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "noise.png")
    patch = PatchRecipe(name="wall", corners=((20, 20), (10, 380), (340, 350), (330, 40)))
    kept: list[KeptPhoto] = []
    photo = KeepPhotoWork(recipe=PhotoRecipe(photo="folder:noise.png", patches=(patch,)))
    Photographer(places).keep(photo, lambda one, *_: kept.append(one))
    recipe = Recipe(
        flow="photo_flattening", sources={"photo": "folder:noise.png"}, size=(64, 64), tileable="both", seed=5,
        files={"surface.geometry": kept[0].geometry},
    )  # fmt: skip
    previewer = Previewer(places)

    def made(largest: int) -> tuple[list[bool], bool]:
        sent: list[PreviewPicture] = []
        request = PreviewRequest(number=1, recipe=recipe, largest=largest)
        previewer.make(request, b"", lambda: None, lambda one, _: sent.append(one))
        return [one.is_final for one in sent if one.done == 1], (
            previewer.store.root / "cache/evaluation.metrics"
        ).exists()

    assert made(0) == ([True], False)
    finals, has_scores = made(400)
    assert finals[-1]
    assert has_scores


def test_the_finest_picture_is_the_result(tmp_path: Path) -> None:
    rows, columns = np.indices((300, 320))
    picture = (127 + 100 * np.sin(columns / 9 + np.sin(rows / 11))).astype(np.uint8)
    (tmp_path / "project").mkdir()
    PIL.Image.fromarray(picture).save(tmp_path / "project/waves.png")
    places = Places(folder=f"{tmp_path}/project", store=f"{tmp_path}/store", scratch=f"{tmp_path}/scratch")
    recipe = Recipe(flow="quilting", sources={"exemplar": "folder:waves.png"}, size=(310, 330), seed=5)
    sent: list[tuple[PreviewPicture, bytes]] = []
    request = PreviewRequest(number=1, recipe=recipe, largest=800)
    Previewer(places).make(request, b"", lambda: None, lambda *told: sent.append(told))
    assert [one.is_final for one, _ in sent] == [False] * (len(sent) - 1) + [True]
    assert len({one.scale for one, _ in sent}) == 2
    last, pixels = sent[-1]
    assert (last.scale, last.height, last.width) == (1, 310, 330)
    options = {"size": (310, 330), "seed": 5, "store": tmp_path / "store", "out": tmp_path / "made"}
    texloom.run("quilting", {"exemplar": tmp_path / "project/waves.png"}, **options)
    whole = np.asarray(PIL.Image.open(tmp_path / "made/texture.png").convert("RGBA"))
    np.testing.assert_array_equal(np.frombuffer(pixels, np.uint8).reshape(310, 330, 4), whole)


def test_a_page_can_stop_finer_pictures(served: Served) -> None:
    large = Recipe(flow="self_tuning", sources={"exemplar": "texloom:bricks"}, size=(2048, 2048))
    small = Recipe(flow="quilting", sources={"exemplar": "folder:blotches.png"}, size=(48, 64))
    with Page(served.base, served.cookie) as page:
        page.send(PreviewRequest(number=1, recipe=large, largest=4096))
        told = next(told for told, _ in page.messages() if told.get("number") == 1 and told["done"] == 1)
        assert not told["is_final"]
        page.send(PreviewStopRequest())
        page.send(PreviewRequest(number=2, recipe=small))
        later = []
        for told, _ in page.messages():
            later += [told] if told["kind"] == "preview_picture" else []
            if later and later[-1]["number"] == 2 and later[-1]["is_final"]:
                break
    assert {one["number"] for one in later} == {2}
