from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.synthetic import LATTICES, bent, difference, picture, points, smooth_noise, stamped, wall
from texloom.stages.analysis.regularity.deformed_lattice import (
    DeformedLattice,
    DeformedLatticeParams,
    check_vertices,
    deformed_lattice,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

NONE = np.zeros((0, 2), np.float32)


def inside(lattice: DeformedLattice, image: Image, margin: float = 0) -> np.ndarray:
    sides = np.array([image.height, image.width])
    return ((lattice.vertices >= margin) & (lattice.vertices < sides - margin)).all(axis=1)


@pytest.mark.parametrize("name", ["half_drop", "hexagonal"])
def test_a_regular_lattice_is_found_where_it_is(name: str, rng: np.random.Generator) -> None:
    image = stamped(LATTICES[name], rng)
    result = deformed_lattice(image, DeformedLatticeParams(), LATTICES[name].astype(np.float32))
    assert difference(result.generators, LATTICES[name]) < 0.3
    assert result.deviation < 0.4
    assert result.detected > 0.4  # those whose cells are whole
    np.testing.assert_allclose(
        result.regular, result.regular[0] + (result.steps - result.steps[0]) @ result.generators, atol=1e-2
    )


def test_a_bent_lattice_is_followed(rng: np.random.Generator) -> None:
    """Vertices keep their place within the cell: warped by the known field they are a regular lattice again."""
    image, field = bent(LATTICES["sheared"], rng)
    result = deformed_lattice(image, DeformedLatticeParams(), LATTICES["sheared"].astype(np.float32))
    kept = inside(result, image, 25)
    assert kept.sum() > 15
    # where each vertex was before the field moved it
    before = result.vertices[kept].astype(float)
    for _ in range(20):
        before = result.vertices[kept] - field(before)
    moves = before - result.steps[kept] @ LATTICES["sheared"]
    away = moves - np.median(moves, axis=0)
    assert np.sqrt((away**2).sum(axis=1).mean()) < 0.5
    assert result.deviation > 1.5


def test_a_lattice_is_not_of_courses(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    assert not deformed_lattice(image, DeformedLatticeParams(), LATTICES["rectangular"].astype(np.float32)).courses


@pytest.mark.parametrize("degrees", [0.0, 90.0, 9.0])
def test_even_courses_are_found_where_they_are(degrees: float, rng: np.random.Generator) -> None:
    """With a second generator along them."""
    image = wall((240, 270), 20, degrees, rng)
    angle = np.radians(degrees)
    period = 20 * np.array([np.cos(angle), np.sin(angle)])
    result = deformed_lattice(image, DeformedLatticeParams(), period.astype(np.float32)[None])
    assert result.courses
    np.testing.assert_allclose(result.generators[0], period, atol=0.15)
    assert abs(result.generators[0] @ result.generators[1]) < 1e-2 * 20 * 40
    np.testing.assert_allclose(np.hypot(*result.generators[1]), 40, atol=0.1)
    assert result.deviation < 0.5
    assert result.detected > 0.5


def test_bent_courses_are_followed(rng: np.random.Generator) -> None:
    straight = wall((240, 270), 20, 0, rng).pixels
    row, column = np.indices((240, 270))
    wave = 3 * np.sin(2 * np.pi * column / 270)
    image = picture(straight[np.clip(np.rint(row - wave).astype(int), 0, 239), column])
    result = deformed_lattice(image, DeformedLatticeParams(), np.float32([[20, 0]]))
    kept = inside(result, image, 25)
    moves = (result.vertices - result.regular)[kept]
    expected = 3 * np.sin(2 * np.pi * result.vertices[kept, 1] / 270)
    away = moves[:, 0] - expected
    assert np.abs(away - np.median(away)).max() < 1
    assert np.abs(moves[:, 1]).max() < 0.1


def test_courses_must_show(rng: np.random.Generator) -> None:
    flat = picture(np.full((90, 90, 3), 0.5))
    with pytest.raises(InputError, match=r"^image: the courses are not detected in the exemplar"):
        deformed_lattice(flat, DeformedLatticeParams(), np.float32([[20, 0]]))


def test_the_picture_shows_it(rng: np.random.Generator) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    result = deformed_lattice(image, DeformedLatticeParams(), LATTICES["rectangular"].astype(np.float32))
    assert result.picture.pixels.shape == image.pixels.shape
    drawn = np.abs(result.picture.pixels - 0.6 * np.clip(image.pixels, 0, 1)).max(axis=2) > 0.05
    row, column = np.rint(result.vertices[inside(result, image, 2)]).astype(int).T
    assert drawn[row, column].all()
    assert drawn.mean() < 0.4


def test_no_lattice(rng: np.random.Generator) -> None:
    noise = picture(smooth_noise((120, 120, 3), 2.0, rng))
    for generators in (None, NONE):
        with pytest.raises(
            InputError, match=r"^generators: the exemplar shows neither a lattice nor courses\. If it"
        ):
            deformed_lattice(noise, DeformedLatticeParams(), generators)
    with pytest.raises(InputError, match="does not contain one whole cell"):
        deformed_lattice(noise, DeformedLatticeParams(), np.array([[300, 0], [0, 300]], np.float32))
    with pytest.raises(InputError, match="cells are not detected"):
        deformed_lattice(
            picture(np.full((90, 90, 3), 0.5)), DeformedLatticeParams(), LATTICES["sheared"].astype("f4")
        )


# -- vertices from a file


def filed(path: Path, content: object) -> DeformedLatticeParams:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return DeformedLatticeParams(vertices=path)


def test_given_vertices_stay_where_they_are(tmp_path: Path, rng: np.random.Generator) -> None:
    image = picture(rng.random((100, 120, 3)))
    steps = np.array([(i, j) for i in range(4) for j in range(4) if (i, j) != (2, 2)])
    places = steps @ [[22, 3], [-2, 27]] + [10, 12] + rng.normal(0, 1, (15, 2))
    params = filed(tmp_path / "a.json", {"vertices": np.column_stack([steps, places]).tolist()})
    result = deformed_lattice(image, params)
    by_step = {tuple(step): place for step, place in zip(result.steps.tolist(), result.vertices, strict=True)}
    for step, place in zip(steps.tolist(), places, strict=True):
        np.testing.assert_allclose(by_step[tuple(step)], place, atol=1e-4)
    # the one left out is where its neighbours lead to, and the lattice covers the exemplar
    np.testing.assert_allclose(
        by_step[2, 2], [2, 2] @ result.generators + result.regular[0] - result.steps[0] @ result.generators, atol=4
    )
    np.testing.assert_allclose(result.generators, [[22, 3], [-2, 27]], atol=1.5)
    assert result.regular.min() < 0
    assert (result.regular.max(axis=0) > [100, 120]).all()


def test_generators_and_one_vertex_are_enough(tmp_path: Path, rng: np.random.Generator) -> None:
    image = picture(rng.random((100, 120, 3)))
    generators = [[20.0, 0.0], [4.0, 25.5]]
    result = deformed_lattice(
        image, filed(tmp_path / "a.json", {"generators": generators, "vertices": [[1, 1, 30, 40]]})
    )
    np.testing.assert_allclose(
        result.vertices, (result.steps - [1, 1]) @ np.array(generators) + [30, 40], atol=1e-3
    )
    assert result.deviation < 1e-3
    assert len(points(np.array(generators), (100, 120), np.array([30, 40]))) >= len(result.steps) * 0.8


SQUARE = [[0, 0, 10, 10], [1, 0, 40, 10], [0, 1, 10, 40]]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", r"a\.json: Invalid JSON: EOF"),
        ("[1]", r"a\.json: Input should be an object, got \[1\]"),
        ({"vertices": SQUARE, "vertexes": []}, "vertexes: no such entry"),
        ({"vertices": []}, "vertices: List should have at least 1 item"),
        ({"vertices": [[0, 0, 1]]}, r"vertices\.0\.3: Field required, got \[0, 0, 1\]"),
        ({"vertices": [[1, 1, 4, None]]}, r"vertices\.0\.3: Input should be a valid number, got None"),
        ({"vertices": [[1, 1, 4, True]]}, r"vertices\.0\.3: Input should be a valid number, got True"),
        ('{"vertices": [[0, 0, 1, NaN]]}', r"vertices\.0\.3: Input should be a finite number, got nan"),
        ({"vertices": [*SQUARE, [0.5, 1, 1, 1]]}, r"vertices\.3\.0: Input should be a valid integer"),
        ({"vertices": [*SQUARE, [1, 0, 1, 1]]}, r"vertices\.3 repeats step \[1, 0\] of vertices\.1$"),
        ({"vertices": SQUARE[:2]}, "generators are missing, and fewer than three vertices are given, or"),
        ({"vertices": SQUARE, "generators": [[1, 2]]}, r"generators\.1: Field required"),
        ({"vertices": SQUARE, "generators": [[1, 2], [3]]}, r"generators\.1\.1: Field required, got \[3\]"),
        ({"vertices": SQUARE, "generators": [[9, 2], [9, 2]]}, "the lattice's cells are smaller than 4 px"),
        ({"vertices": [*SQUARE, [1, 1, 900, 40]]}, r"vertices\.3: \(900, 40\) is far outside the exemplar"),
        ({"vertices": [*SQUARE, [1, 1, 4e9, 40]]}, r"vertices\.3\.2: Input should be less than or equal to 100000"),
        ({"vertices": SQUARE, "generators": [[0, 30], [30, 0]]}, r"the cell at step \[0, 0\] is inverted"),
    ],
)
def test_bad_files(content: object, words: str, tmp_path: Path) -> None:
    """One line that names file and entry, before anything runs."""
    params = filed(tmp_path / "a.json", content)
    with pytest.raises(InputError, match=words) as caught:
        check_vertices(params, {"image": picture(np.zeros((60, 80, 3)))})
    assert str(caught.value).startswith(f"vertices: {tmp_path / 'a.json'}: ")
    assert "\n" not in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"vertices: .*none\.json: No such file"):
        check_vertices(DeformedLatticeParams(vertices=tmp_path / "none.json"), {})
