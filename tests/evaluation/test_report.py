from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.evaluation.helpers import EVIL, encoded, load, pictures, score_line
from texloom.stages.evaluation._pages import page as pages
from texloom.stages.evaluation._pages import plots, text
from texloom.stages.evaluation.comparison_report import ComparisonReportParams, comparison_report
from texloom.stages.evaluation.metrics import MetricsParams, metrics
from texloom.stages.evaluation.regularity import RegularityParams, regularity
from texloom.stages.evaluation.report import ReportParams, lattice_path, report
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

PROVENANCE = [
    {
        "step": f"edges {EVIL}",
        "item": EVIL,
        "stage": "analysis.edges",
        "version": 3,
        "params": {"file": EVIL, EVIL: [1, 2]},
        "seed": "7/edges",
        "key": "0123456789abcdef" * 4,
        "program": "texloom 0.1.0",
        "created": "2026-11-21T09:00:00+00:00",
        "seconds": 0.125,
    }
]


def levels(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


def shown(height: int, width: int, seed: int = 0) -> Image:
    return encoded(levels(height, width, seed) / 255)


def table(score: float | None = 0.25) -> dict[str, Any]:
    fidelity = {**score_line("fidelity", score, 0.5, 0.125), "what": f"What {EVIL}"}
    return {
        "summary": {"fidelity": score, "variety": None},
        "measures": {
            "colors": {**fidelity, "more": {"levels": [1.0, 2.0], "groups": {"mean": 0.5}}},
            "use": {**score_line("variety", None, None), "reason": f"no map {EVIL}"},
        },
    }


def whole_report(largest: int = 2048) -> str:
    rng = np.random.default_rng(1)
    return report(
        shown(48, 64),
        shown(96, 80, 1),
        table(),
        ReportParams(title=f"Bricks {EVIL}", largest=largest),
        distance=rng.normal(size=(48, 64)).astype(np.float32),
        structure=rng.random((48, 64)) > 0.5,
        generators=np.float32([[0, 16], [12, 8]]),
        occurrence=rng.random((48, 64), np.float32),
        scales=[
            {"height": 48, "width": 40, "rounds": 3, "energy": 9.0, "price": 1.0, "changed": 0.5},
            {"height": 96, "width": 80, "rounds": 3, "energy": 4.0, "price": 0.5, "changed": 0.125},
        ],
        regularity=table(1.0),
        provenance=PROVENANCE,
    ).page


def whole_comparison() -> str:
    one, tall = shown(40, 40), shown(64, 48, 2)
    counts = {"wins": 1, "losses": 2, "ties": 0, "rate": 1 / 3}
    pair = {"one": "plain", "other": EVIL, **counts, "p": 0.03, "holm": 0.03}
    part = {"means": {"plain": 0.25, EVIL: 0.75}, "pairs": [pair], "rates": {"plain": 1 / 3, EVIL: 2 / 3}}
    line = {
        "rank": 1,
        "method": EVIL,
        "origin": EVIL,
        "mean": 0.75,
        "interval": [0.5, 0.875],
        "ranks": [1, 2],
        "rate": 2 / 3,
    }
    low, middle, high = ({"overall": score, "axes": {"fidelity": score}} for score in (0.25, 0.5, 0.75))
    return comparison_report(
        [one, shown(40, 40), None],
        {
            "plain": [tall, shown(40, 40, 3), shown(40, 40, 4)],
            EVIL: [shown(40, 40, 5), None, one],
        },
        {
            "methods": ["plain", EVIL],
            "scores": {"plain": [low] * 3, EVIL: [high, None, middle]},
            "leaderboard": [{**line, "wins": 2, "losses": 1, "ties": 0}],
            "partial": [f"use {EVIL}"],
            "measures": {
                "colors": {"axis": "fidelity", "what": f"What {EVIL}", "values": {EVIL: 3.25}, **part},
                "use": {"means": {}},
            },
            "axes": {"fidelity": part},
            "overall": part,
        },
        ComparisonReportParams(largest=32),
        items=[
            {"name": "a", "seed": 1, "sources": {"exemplar": EVIL}},
            {"name": "a", "seed": 2, "sources": {}},
            {"name": "b", "seed": 1},
        ],
        provenance=[{**PROVENANCE[0], "item": f"a, seed {seed}"} for seed in (1, 2)],
    ).page


@pytest.fixture(scope="module")
def page() -> str:
    return whole_report()


@pytest.fixture(scope="module")
def grid() -> str:
    return whole_comparison()


# -- contents of the page


def test_same_inputs_same_bytes(page: str, grid: str) -> None:
    assert whole_report() == page
    assert whole_comparison() == grid


def test_pictures_are_lossless(page: str) -> None:
    _, exemplar, result, mask, field, occurrence = pictures(page)
    np.testing.assert_array_equal(exemplar, levels(48, 64))
    np.testing.assert_array_equal(result, levels(96, 80, 1))
    assert set(np.unique(mask)) == {0, 255}
    assert field.shape == occurrence.shape == (48, 64, 3)


def test_large_pictures_are_reduced() -> None:
    html = whole_report(32)
    sizes = [picture.shape[:2] for picture in pictures(html)]
    assert sizes == [(96, 80), (24, 32), (32, 27), (24, 32), (24, 32), (24, 32)]
    assert "80 x 96 px, shown from 27 x 32 px" in html


def test_pictures_are_reduced_in_linear_light() -> None:
    stripes = encoded(np.repeat([[0.0], [1.0]] * 8, 16, axis=1))
    (picture,) = pictures(f'<img src="{pages.shown(stripes, 8).source}">')
    assert np.unique(picture).tolist() == [188]


def test_colours_outside_the_range_of_screens_are_clipped() -> None:
    odd = Image(np.float32([[[np.nan, np.inf, -np.inf], [2, -1, 0]]]), ("R", "G", "B"))
    (picture,) = pictures(f'<img src="{pages.shown(odd, 64).source}">')
    assert picture.tolist() == [[[0, 255, 0], [255, 0, 0]]]


def test_colours_of_a_field_show_its_sign() -> None:
    field = np.float32([[-9, 0, 9, np.nan]]).repeat(4, axis=0)
    (picture,) = pictures(f'<img src="{pages.shown_field(field, 0.0, 9.0, 64).source}">')
    low, middle, high, unknown = picture[0].astype(int)
    assert low[2] > low[0] + 50
    assert middle.min() > 230
    assert high[0] > high[2] + 50
    assert not unknown.any()


def material(height: int, width: int, seed: int) -> tuple[Image, dict[str, np.ndarray]]:
    """A material and the 8-bit levels that its maps are shown in."""
    levels_of = {
        name: np.random.default_rng([seed, index]).integers(0, 256, (height, width, planes), np.uint8)
        for index, (name, planes) in enumerate(
            {"color": 3, "normal": 3, "height": 1, "emissive": 3, "odd": 2}.items()
        )
    }
    planes = {
        "color": linear_from_srgb(levels_of["color"] / 255),
        "normal": levels_of["normal"] / 255 * 2 - 1,
        "height": levels_of["height"] / 255,
        "emissive": linear_from_srgb(levels_of["emissive"] / 255),
        "odd": levels_of["odd"] / 255,
    }
    names = ("R", "G", "B", *NORMAL, "height", "emissive.R", "emissive.G", "emissive.B", "odd.U", "odd.V")
    pixels = np.concatenate(list(planes.values()), axis=2).astype(np.float32)
    return Image(pixels, names), levels_of


def test_each_map_is_shown_beside_the_exemplars() -> None:
    (exemplar, theirs), (result, ours) = material(20, 30, 1), material(40, 24, 2)
    lit = shown(24, 60, 3)
    html = report(exemplar, result, table(), ReportParams(), preview=lit).page
    images = pictures(html)[1:]
    assert re.findall(r'id="map-([a-z]+)"', html) == ["color", "normal", "height", "emissive"]
    assert re.findall(r'name="map" value="([a-z]+)"', html) == ["color", "normal", "height", "emissive"]
    for index, name in enumerate(("color", "normal", "height", "emissive")):
        for picture, known in zip(images[2 * index :], (theirs, ours), strict=False):
            np.testing.assert_array_equal(picture, np.broadcast_to(known[name], picture.shape))
    assert len(images) == 9
    assert images[8].shape == (24, 60, 3)
    for option in ("exemplar, height", "result, height", 'aria-label="lit preview"', "from -1 to 1"):
        assert option in html


def test_maps_beyond_black_and_white_are_shown_on_the_exemplars_scale() -> None:
    heights = [np.float32([[-2, 0], [2, 6]]), np.float32([[2, 9], [-9, 4]])]
    pair = [Image(np.stack([plane, plane], axis=2), ("Y", "height")) for plane in heights]
    html = report(*pair, table(), ReportParams()).page
    theirs, ours = (picture[..., 0].tolist() for picture in pictures(html)[3:])
    assert theirs == [[0, 64], [128, 255]]
    assert ours == [[128, 255], [0, 191]]
    assert "From -2, black, to 6, white." in html


@pytest.mark.parametrize("name", ["page", "grid"])
def test_texts_are_escaped(name: str, request: pytest.FixtureRequest) -> None:
    html = request.getfixturevalue(name)
    html.encode()
    assert html.count("<script") == html.count("</script") == 1
    assert "<img src=http" not in html
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in html


def test_figures_are_written_out(page: str) -> None:
    for words in (">0.25</b>", "use (no map", "levels: 1, 2", "groups: mean 0.5", "0123456789ab</code>"):
        assert words in page
    assert "0.12 s" in page


def test_what_was_not_given_is_left_out() -> None:
    html = report(shown(8, 8), shown(9, 9), {}, ReportParams()).page
    assert len(pictures(html)) == 3
    assert re.findall("<h2.*?>(.*?)</h2>", html) == ["Exemplar and result"]
    for words in ('type="checkbox"', 'name="map"', "no lattice"):
        assert words not in html


def test_an_exemplar_without_a_lattice_is_said_to_have_none() -> None:
    none = np.zeros((0, 2), np.float32)
    assert "no lattice" in report(shown(8, 8), shown(9, 9), {}, ReportParams(), generators=none).page


def test_a_table_without_any_score_is_left_out() -> None:
    one = shown(8, 8)
    lost = {"axis": "regularity", "value": None, "score": None, "reason": "the exemplar has no lattice"}
    regularity = {"summary": {"regularity": None}, "measures": {"recall": lost, "period": lost}}
    html = report(one, one, table(), ReportParams(), regularity=regularity).page
    assert re.findall("<h2.*?>(.*?)</h2>", html) == ["Exemplar and result", "Scores"]
    assert html.count('<dl class="measures">') == 1


def test_measures_without_a_score_are_listed_by_reason() -> None:
    one = shown(8, 8)
    lost = {"axis": "variety", "value": None, "score": None, "reason": "no source map"}
    measures = {
        "colors": score_line("fidelity", 0.5, 0.5),
        "use": lost,
        "cells": {**lost, "reason": "b"},
        "copying": lost,
    }
    html = report(one, one, {"measures": measures}, ReportParams()).page
    assert "Not scored: use, copying (no source map); cells (b)." in html
    assert "look at the tiled view as well" in html


def test_each_score_says_what_it_cannot_detect() -> None:
    one = encoded(np.random.default_rng(0).random((64, 64, 3)))
    measures = metrics(one, one.wrapping(True), MetricsParams()).table["measures"]
    regular = regularity(one, one, RegularityParams()).table["measures"]
    for name in [*measures, *regular]:
        html = report(one, one, {"measures": {name: score_line("a", 0.5, 0.5)}}, ReportParams()).page
        assert "Cannot detect: " in html, name


def test_limits_and_estimates_are_shown_beside_the_scores() -> None:
    known = table()
    known["measures"]["colors"]["estimated"] = True
    known["limits"] = [f"Letters {EVIL}"]
    page = report(shown(48, 64), shown(48, 64), known, ReportParams()).page
    assert "No score detects:" in page
    assert "<li>Letters &lt;script&gt;" in page
    assert 'colors <span class="soft">estimated</span>' in page
    plain = report(shown(48, 64), shown(48, 64), table(), ReportParams()).page
    assert "No score detects" not in plain
    assert ">estimated<" not in plain


def test_the_worst_places_are_shown() -> None:
    one = shown(120, 160)
    joints = np.zeros((120, 160), np.float32)
    joints[20:24, 30:34], joints[100, 150], joints[25, 32] = 3.5, 2.25, 3.0
    html = report(one, one, table(), ReportParams(), joints=joints).page
    assert re.findall(r'data-row="(\d+)" data-column="(\d+)"', html) == [("22", "32"), ("100", "150")]
    assert html.count('<i class="mark"') == 2
    assert "difference 3.5<" in html
    for known in (None, np.zeros_like(joints)):
        assert "Places to check" not in report(one, one, table(), ReportParams(), joints=known).page
    assert "Places to check" not in report(one, one, table(), ReportParams(places=0), joints=joints).page


def test_a_large_result_is_shown_by_the_means_of_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    small = Image(rng.random((20, 30, 3), np.float32), ("R", "G", "B"))
    large = Image(small.pixels.repeat(3, axis=0).repeat(3, axis=1), small.channels)
    monkeypatch.setattr(pages, "_LARGE", 30)
    np.testing.assert_allclose(pages.overview(large).pixels, small.pixels, atol=1e-6)
    assert pages.overview(small) is small
    html = report(small, large, table(), ReportParams()).page
    assert "90 x 60 px, shown from 30 x 20 px" in html


def test_maps_must_fit_the_exemplar() -> None:
    one = shown(8, 8)
    with pytest.raises(InputError, match="structure is 9 x 8 px, the exemplar 8 x 8 px"):
        report(one, one, {}, ReportParams(), structure=np.zeros((8, 9), bool))
    with pytest.raises(InputError, match="joints is 8 x 9 px, the result 8 x 8 px"):
        report(one, one, {}, ReportParams(), joints=np.zeros((9, 8), np.float32))


@pytest.mark.parametrize("generators", [[[0, 16], [12, 8]], [[10, 0], [0, 7]], [[9, 4], [-3, 11]]])
def test_lattice_lines_cross_at_lattice_points(generators: list[list[float]]) -> None:
    height, width = 60, 90
    lines = re.findall(
        r"M([\d.-]+) ([\d.-]+)L([\d.-]+) ([\d.-]+)", lattice_path(np.float32(generators), height, width)
    )
    segments = np.array(lines, np.float64).reshape(-1, 2, 2)[..., ::-1]  # row, column
    directions = segments[:, 1] - segments[:, 0]
    directions /= np.hypot(*directions.T)[:, None]
    for generator in np.float64(generators):
        unit = generator / np.hypot(*generator)
        family = np.abs(directions @ [unit[1], -unit[0]]) < 1e-2
        across = segments[family, 0] - [height / 2, width / 2]
        offsets = across @ [-unit[1], unit[0]]
        other = next(one for one in np.float64(generators) if not np.array_equal(one, generator))
        spacing = abs(other @ [-unit[1], unit[0]])
        np.testing.assert_allclose(offsets / spacing, np.rint(offsets / spacing), atol=0.05)
        corners = [abs(np.dot([row, column], [-unit[1], unit[0]])) for row in (-30, 30) for column in (-45, 45)]
        assert np.abs(offsets).max() > max(corners) - spacing, "the whole picture is covered"


def test_courses_are_drawn_as_parallel_lines() -> None:
    lines = re.findall(r"M([\d.-]+) ([\d.-]+)L([\d.-]+) ([\d.-]+)", lattice_path(np.float32([[10, 0]]), 60, 90))
    rows = np.array(lines, np.float64)[:, [1, 3]]
    np.testing.assert_allclose(rows[:, 0], rows[:, 1])
    np.testing.assert_allclose(rows[:, 0] % 10, 0)
    assert {0, 10, 20, 30, 40, 50, 60} <= set(rows[:, 0])
    one = shown(60, 90)
    html = report(one, one, table(), ReportParams(), generators=np.float32([[10, -0.01]])).page
    assert "courses of (10.0, 0.0) px" in html


@pytest.mark.parametrize("generators", [np.zeros((0, 2)), [[3, 4], [6, 8]], [[0, 0], [0, 0]]])
def test_no_lattice_no_lines(generators: Any) -> None:
    assert lattice_path(np.float32(generators), 50, 50) == ""


def test_colours_of_scores() -> None:
    assert [text.score_color(score) for score in (0, 0.5, 1)] == [
        "rgb(213 94 0)",
        "rgb(240 228 66)",
        "rgb(0 158 115)",
    ]
    assert text.score_color(None) == text.score_color(float("nan")) == "rgb(128 128 128)"
    assert text.score_color(7) == text.score_color(1)


def test_plots_take_the_pages_colour() -> None:
    svg = plots.paired_scores({"$fi$delity": {EVIL: [0.5, None], "砖": [0.25, 0.5]}})
    assert svg.startswith("<svg")
    assert "currentColor" in svg
    assert "<script" not in svg
    assert "砖" in svg
    assert plots.paired_scores({"fidelity": {"a": [None], "b": [0.5]}}) == ""


def test_dots_are_means_of_items_that_all_methods_have() -> None:
    scores = {"fidelity": {"a": [0.0, 1.0, 0.5], "b": [0.5, 1.0, None]}, "novelty": {"a": [1.0], "b": [0.0]}}
    root = ElementTree.fromstring(plots.paired_scores(scores))
    dots = [float(one.attrib["cy"]) for one in root.iter("{http://www.w3.org/2000/svg}circle")]
    top, bottom = dots[2:]
    np.testing.assert_allclose(dots[:2], [(top + bottom) / 2, bottom + 0.75 * (top - bottom)], atol=0.1)
    lines = [one.attrib["points"] for one in root.iter("{http://www.w3.org/2000/svg}polyline")]
    assert [len(line.split()) for line in lines] == [2, 2, 2]


def test_bars_of_nothing_are_empty() -> None:
    assert plots.energies([{"energy": None}, {}]) == ""


def test_bars_show_energies_and_changes() -> None:
    scales = [
        {"height": 8, "width": EVIL, "energy": 40.0, "price": 10.0, "changed": 0.5},
        {"height": 16, "width": 32, "energy": 20.0, "price": None, "changed": None},
    ]
    root = ElementTree.fromstring(plots.energies(scales))
    rects = [rect for rect in root.iter("{http://www.w3.org/2000/svg}rect") if float(rect.attrib["height"]) != 9]
    heights = np.array([float(rect.attrib["height"]) for rect in rects])
    np.testing.assert_allclose(heights / heights[0], [1, 1 / 3, 2 / 3, 0, 4 / 3, 0], atol=0.01)
    texts = [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"32 x 16", "0", "10", "20", "30", "40", "50"} < set(texts)
    assert any(text.endswith(" x 8") for text in texts if text)


def test_steps_that_differ_by_item_share_a_line() -> None:
    entry = PROVENANCE[0]
    lines = pages.steps([entry, {**entry, "item": "b", "seconds": 1}, {**entry, "version": 4}, {}])
    assert [(len(line["runs"]), line["seconds"]) for line in lines] == [(2, 1.125), (1, 0.125), (1, None)]


def test_a_grid_names_what_failed(grid: str) -> None:
    assert len(pictures(grid)) == 1 + 5  # the same exemplar is shown once
    assert grid.count('class="missing">failed') == 1
    assert '<td rowspan="2">' in grid
    assert "1 – 2 – 0" in grid
    assert "2 – 1 – 0" in grid
    assert "2 runs" in grid
    assert "[0.500, 0.875]" in grid
    assert ">3.25</small>" in grid
    assert "In 1 row, results differ in size" in grid


def test_a_grid_does_not_depend_on_when_it_was_made() -> None:
    one = shown(8, 8)
    pages = {
        comparison_report(
            [one],
            {"a": [one]},
            {},
            ComparisonReportParams(),
            provenance=[{**PROVENANCE[0], "created": when, "seconds": took}],
        ).page
        for when, took in (("2026-11-21T09:00:00+00:00", 1.0), ("2027-11-21T09:00:00+00:00", 2.0))
    }
    assert len(pages) == 1


def test_all_pictures_of_a_grid_have_one_scale() -> None:
    """That of the largest result; of a larger exemplar, only the centre is shown."""
    exemplars = [shown(40, 40), shown(90, 30, 1)]
    images = {"a": [shown(64, 48, 2), shown(16, 16, 3)], "b": [shown(64, 48, 4), shown(64, 64, 5)]}
    html = comparison_report(exemplars, images, {}, ComparisonReportParams(largest=32)).page
    sizes = [(20, 20), (32, 24), (32, 24), (32, 15), (8, 8), (32, 32)]
    assert [picture.shape[:2] for picture in pictures(html)] == sizes
    shares = [float(share) for share in re.findall(r"var\(--side\) \* ([\d.]+)\)", html)]
    assert shares == pytest.approx([width / 32 for _, width in sizes], abs=0.001)
    assert "centre of 30 x 90 px" in html
    assert "In 1 row, results differ in size" in html


def test_the_best_are_those_that_are_shown_alike() -> None:
    one = shown(8, 8)
    means = {"a": 0.9854, "b": 0.9846, "c": 0.9851}
    measure = {"axis": "fidelity", "what": "What", "means": means}
    summary = {"methods": list(means), "measures": {"colors": measure}, "axes": {"fidelity": {}}}
    html = comparison_report([one], {name: [one] for name in means}, summary, ComparisonReportParams()).page
    assert re.findall(r'<td( class="best")?>(?:(?!<td).)*?<b>(0\.\d+)</b>', html) == [
        (' class="best"', "0.99"),
        ("", "0.98"),
        (' class="best"', "0.99"),
    ]


def test_an_empty_summary_is_no_error() -> None:
    one = shown(8, 8)
    html = comparison_report([one], {"a": [None]}, {}, ComparisonReportParams()).page
    assert "Wins" not in html
    assert "item 1" in html


def test_lists_must_be_of_one_length() -> None:
    one = shown(8, 8)
    with pytest.raises(InputError, match=r"images\.a has 2 entries, exemplars has 1"):
        comparison_report([one], {"a": [one, one]}, {}, ComparisonReportParams())
    with pytest.raises(InputError, match="items has 2 entries"):
        comparison_report([one], {"a": [one]}, {}, ComparisonReportParams(), items=[{}, {}])


# -- in a browser


def centre(tab: Any, index: int) -> list[float]:
    """The centre of a view on the screen."""
    box = f"document.querySelectorAll('.view')[{index}].getBoundingClientRect()"
    return tab.evaluate(f"(() => {{ const b = {box}; return [b.left + b.width / 2, b.top + b.height / 2]; }})()")


def drag(tab: Any, start: list[float], by: tuple[int, int]) -> None:
    """Drag from a place on the screen up and left."""
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(start[0] - by[0], start[1] - by[1], steps=3)
    tab.mouse.up()


def test_zoom_in_a_browser(tab: Any, page: str, tmp_path: Path) -> None:
    load(tab, page, tmp_path)
    widths = "[...document.querySelectorAll('#pictures .sheet img')].map(one => one.getBoundingClientRect().width)"
    press = "document.querySelector('#pictures button[data-scale=\"{}\"]').click()"
    exemplar, result = tab.evaluate(widths)
    assert exemplar / result == pytest.approx(64 / 80, rel=0.01)
    for scale in (1, 2, 4):
        tab.evaluate(press.format(scale))
        assert tab.evaluate(widths) == [64 * scale, 80 * scale]
        pressed = "document.querySelector('#pictures button[aria-pressed=true]').dataset.scale"
        assert tab.evaluate(pressed) == str(scale)
    rendering = "getComputedStyle(document.querySelector('#pictures .sheet img')).imageRendering"
    assert tab.evaluate(rendering) == "pixelated"
    tab.evaluate(press.format("fit"))
    assert tab.evaluate(widths) == [exemplar, result]

    tab.evaluate("document.querySelectorAll('#pictures .view')[1].scrollIntoView({block: 'center'})")
    box = centre(tab, 1)
    for _ in range(2):  # to 100 %, to 200 %
        tab.mouse.click(*box)
    assert tab.evaluate(widths) == [128, 160]
    drag(tab, box, (30, 30))
    assert tab.evaluate(widths) == [128, 160], "a drag is no click"


def test_dragging_moves_the_picture(tab: Any, tmp_path: Path) -> None:
    one = shown(900, 1400)
    load(tab, report(one, one, {}, ReportParams()).page, tmp_path)
    tab.evaluate("document.querySelector('button[data-scale=\"2\"]').click()")
    at = "[...document.querySelectorAll('[data-map] .view')].map(one => [one.scrollLeft, one.scrollTop])"
    before = tab.evaluate(at)
    drag(tab, centre(tab, 0), (40, 80))
    assert tab.evaluate(at) == [[before[0][0] + 40, before[0][1] + 80], before[1]]
    assert tab.evaluate("document.querySelector('.sheet img').getBoundingClientRect().width") == 2800


def test_the_lattice_is_shown_on_request(tab: Any, page: str, tmp_path: Path) -> None:
    load(tab, page, tmp_path)
    style = "getComputedStyle(document.querySelector('.lattice')).display"
    assert tab.evaluate(style) == "none"
    tab.evaluate("document.querySelector('[data-shows=lattice]').click()")
    assert tab.evaluate(style) != "none"


def test_one_viewer_shows_every_map_in_three_ways(tab: Any, tmp_path: Path) -> None:
    (exemplar, _), (result, _) = material(60, 90, 1), material(120, 80, 2)
    load(tab, report(exemplar, result, table(), ReportParams()).page, tmp_path)
    visible = "[...document.querySelectorAll('[data-map], [data-panel]')].filter(one => one.clientWidth)"
    shown_now = f"{visible}.map(one => one.dataset.map ?? one.dataset.panel)"
    choose = "document.querySelector('input[value={}]').click()"
    assert tab.evaluate(shown_now) == ["color"]
    tab.evaluate(choose.format("normal"))
    assert tab.evaluate(shown_now) == ["normal"]
    tab.evaluate(choose.format("slider"))
    assert tab.evaluate(shown_now) == ["slider"]
    same = "getComputedStyle(document.querySelector('{}')).backgroundImage.includes("
    same += "document.querySelector('[data-map=normal] [data-role={}] img').src.slice(-200))"
    assert tab.evaluate(same.format("[data-layer=exemplar]", "exemplar"))
    assert tab.evaluate(same.format("[data-layer=result]", "result"))
    tab.evaluate(choose.format("tiled"))
    assert tab.evaluate(shown_now) == ["tiled"]
    assert tab.evaluate(same.format("[data-panel=tiled] .sheet", "result"))
    tab.evaluate("document.querySelector('#pictures button[data-scale=\"2\"]').click()")
    assert tab.evaluate("document.querySelector('[data-panel=tiled] .sheet').getBoundingClientRect().width") == 320


def test_the_slider_obeys_mouse_and_keys(tab: Any, page: str, tmp_path: Path) -> None:
    load(tab, page, tmp_path)
    tab.evaluate("document.querySelector('input[value=slider]').click()")
    tab.evaluate("document.querySelector('.window').scrollIntoView({block: 'center'})")
    box = "document.querySelector('.window').getBoundingClientRect()"
    left, top, width, height = tab.evaluate(f"[{box}.left, {box}.top, {box}.width, {box}.height]")
    assert width / height == pytest.approx(64 / 48, rel=0.01), "what both pictures have"
    at = "parseFloat(document.querySelector('.window').style.getPropertyValue('--at'))"
    assert tab.evaluate(at) == 50
    tab.mouse.click(left + width / 4, top + height / 2)
    assert tab.evaluate(at) == pytest.approx(25, abs=1)
    before = tab.evaluate(at)
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate(at) > before


def test_a_place_is_shown_in_the_result(tab: Any, tmp_path: Path) -> None:
    one = shown(900, 1400)
    joints = np.zeros((900, 1400), np.float32)
    joints[700, 300] = 2.0
    load(tab, report(one, one, {}, ReportParams(), joints=joints).page, tmp_path)
    mark = "document.querySelector('.mark')"
    assert tab.evaluate(f"getComputedStyle({mark}).display") == "none"
    tab.evaluate("document.querySelector('.place').focus()")
    tab.keyboard.press("Enter")
    offset = (
        f"(() => {{ const m = {mark}.getBoundingClientRect(), v = {mark}.closest('.view').getBoundingClientRect();"
    )
    offset += (
        " return [m.left + m.width / 2 - v.left - v.width / 2, m.top + m.height / 2 - v.top - v.height / 2]; })()"
    )
    assert tab.evaluate(offset) == pytest.approx([0, 0], abs=12)
    assert tab.evaluate("document.querySelector('#pictures').dataset.zoom") == "2"


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(tab: Any, page: str, tmp_path: Path, width: int) -> None:
    tab.set_viewport_size({"width": width, "height": 800})
    command = "texloom run self_tuning --source exemplar=a-long-name.png " * 5
    load(tab, page.replace("></code><button", f">{command}</code><button"), tmp_path)
    for view in ("pair", "slider", "tiled"):
        tab.evaluate(f"document.querySelector('input[value={view}]').click()")
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, view


def test_a_grid_in_a_browser(tab: Any, grid: str, tmp_path: Path) -> None:
    load(tab, grid, tmp_path)
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    tab.evaluate("document.querySelectorAll('.thumb')[1].click()")
    state = "[document.querySelector('dialog').open, [...document.querySelectorAll('.thumb img')]"
    state += ".findIndex(one => one.src === document.querySelector('dialog img').src)]"
    assert tab.evaluate(state) == [True, 1]
    width = tab.evaluate("document.querySelector('dialog img').clientWidth")
    assert width > 24, "small pictures are enlarged"
    assert width % 24 == 0, "by a whole factor"
    for key, place in (("ArrowRight", 2), ("ArrowLeft", 1), ("ArrowDown", 3), ("ArrowUp", 1)):
        tab.keyboard.press(key)
        assert tab.evaluate(state) == [True, place], key
    assert tab.evaluate("document.querySelector('dialog img').clientWidth") == width, "the scale is that of all"
    tab.evaluate("document.querySelector('[data-close]').click()")
    assert not tab.evaluate("document.querySelector('dialog').open")


def test_what_the_exemplar_shows_once_is_told() -> None:
    one = shown(64, 64)
    known = {"why": "2.0% of the exemplar are shown once"}
    page = report(one, one, table(), ReportParams(), one_off=known, one_off_picture=one).page
    assert known["why"] in page
    assert "what the exemplar shows once" in page
    assert "Shown once" not in report(one, one, table(), ReportParams(), one_off={"why": ""}).page
