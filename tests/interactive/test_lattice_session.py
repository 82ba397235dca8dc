from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import texloom
from tests.synthetic import LATTICES, bent, difference, stamped
from texloom.stages.analysis.regularity.deformed_lattice import DeformedLatticeParams, deformed_lattice
from texloom.stages.interactive.lattice_session import LatticeSession
from texloom.stages.vocabulary.declare import InputError


def test_the_lattice_is_bit_identical_to_that_of_the_saved_file(rng: np.random.Generator, tmp_path: Path) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    session = LatticeSession(image, stiffness=0.1)
    session.span((3.3, 4.1), *LATTICES["rectangular"])
    session.move((1, 2), (60.125, 111))
    session.move((2, 2), (90, 115))
    session.release((2, 2))
    session.save(tmp_path / "tiles.yaml")
    params = DeformedLatticeParams(vertices=tmp_path / "tiles_vertices.json", stiffness=0.1)
    wanted = deformed_lattice(image, params)
    for name, value in vars(session.lattice()).items():
        if name != "picture":
            np.testing.assert_array_equal(value, getattr(wanted, name), err_msg=name)
    again = LatticeSession(image, session.content(), stiffness=0.1)
    np.testing.assert_array_equal(again.lattice().vertices, wanted.vertices)


def test_a_detected_lattice_is_straightened(rng: np.random.Generator) -> None:
    image, _ = bent(LATTICES["sheared"], rng)
    session = LatticeSession(image)
    session.detect()
    lattice = session.lattice()
    assert difference(lattice.generators, LATTICES["sheared"]) < 1.5
    assert lattice.detected == 1
    # in the preview, cells repeat better than in the exemplar
    step = np.rint(lattice.generators[0]).astype(int)

    def likeness(plane: np.ndarray) -> float:
        height, width = plane.shape
        rows, columns = (np.s_[40 : side - 40] for side in (height, width))
        one = plane[rows, columns]
        other = np.roll(plane, -step, (0, 1))[rows, columns]
        return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])

    straight = session.preview()[..., 1].astype(float)
    assert straight.shape == (image.height, image.width)
    assert likeness(straight) > likeness(image.color[..., 1].astype(float)) + 0.1


def test_a_vertex_that_moves_takes_its_neighbours_along(rng: np.random.Generator) -> None:
    session = LatticeSession(stamped(LATTICES["rectangular"], rng))
    session.span((5, 5), *LATTICES["rectangular"])
    before = session.lattice()
    place = before.vertices[(before.steps == (1, 1)).all(axis=1)][0]
    for near in ((0, 1), (1, 0), (3, 3)):
        session.move(near, before.vertices[(before.steps == near).all(axis=1)][0])
    session.move((1, 1), (place[0] + 4, place[1]))
    moved = session.lattice().vertices - before.vertices
    np.testing.assert_allclose(moved[(before.steps == (1, 1)).all(axis=1)][0], (4, 0), atol=1e-4)
    assert moved[(before.steps == (2, 2)).all(axis=1)][0, 0] > 0.3
    np.testing.assert_allclose(moved[(before.steps == (0, 1)).all(axis=1)][0], 0, atol=1e-4)


def test_the_saved_flow_runs(rng: np.random.Generator, tmp_path: Path) -> None:
    image = stamped(LATTICES["rectangular"], rng)
    session = LatticeSession(image)
    session.span((5, 5), *LATTICES["rectangular"])
    flow = session.save(tmp_path / "My tiles.yaml")
    done = texloom.run(flow, {"exemplar": image.color}, size=96, store=tmp_path / "store", out=tmp_path / "out")
    np.testing.assert_array_equal(done["vertices"].vertices, session.lattice().vertices)


def test_what_is_wrong_is_said(rng: np.random.Generator) -> None:
    session = LatticeSession(stamped(LATTICES["rectangular"], rng))
    assert session.validity() == "vertices: there is no lattice; span or detect one"
    session.span((5, 5), (30, 0), (0, 40))
    assert session.validity() is None
    session.move((0, 1), (5, -35))
    session.move((1, 0), (35, 5))
    assert session.validity() == "the cell at step [0, 0] is inverted"
    with pytest.raises(InputError, match="inverted"):
        session.preview()
    with pytest.raises(InputError, match=r"vertices: vertices\.0"):
        LatticeSession(session.image, {"vertices": [[0, 0, 1]]})
