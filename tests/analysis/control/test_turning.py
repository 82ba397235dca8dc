"""Whether a texture turns with its control map, on pairs of which it is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.control.turning import Turning, TurningParams, turning, unpredicted
from texloom.stages.common.features.control import from_painted
from texloom.stages.synthesis.reconstruction.either_way import either_way
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SIDE = 192


def measured(texture: np.ndarray, control: np.ndarray, **params: object) -> Turning:
    painted = from_painted(np.asarray(control[..., None], np.float32), ("Y",))
    return turning(picture(np.clip(texture, 0, 1)), painted, TurningParams(**params))  # type: ignore[arg-type]


def grain(seed: int, along: float = 6.0, side: int = 3 * SIDE) -> np.ndarray:
    """Fibres along rows, standard deviation 1."""
    made = gaussian_filter(np.random.default_rng(seed).normal(size=(side, side)), (1.2, along))
    return np.asarray(made / made.std())


def river(seed: int, amplitude: float = 30.0, turned: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance to a line that winds, and rows and columns of a texture that lies along it."""
    rows, columns = np.indices((SIDE, SIDE)) - SIDE / 2
    along = columns * np.cos(turned) + rows * np.sin(turned)
    across = rows * np.cos(turned) - columns * np.sin(turned)
    across = across - amplitude * np.sin(along / SIDE * 2 * np.pi + seed)
    return np.abs(across) / SIDE, across + 1.5 * SIDE, along + 1.5 * SIDE


def coloured(distance: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """Water near the line, land farther off, with a grain."""
    land = np.tanh((distance * SIDE - 10) / 4)[..., None]
    return np.asarray([0.4, 0.45, 0.5] + land * [0.1, 0.05, -0.15] + 0.07 * grey[..., None])


@pytest.mark.parametrize(("seed", "turned"), [(1, 0.0), (2, 0.7)])
def test_grain_along_a_river_turns(seed: int, turned: float) -> None:
    distance, rows, columns = river(seed, turned=turned)
    grey = map_coordinates(grain(seed), [rows, columns], order=1)
    found = measured(coloured(distance, grey), distance)
    assert found.table["chosen"] == ["turned"]
    assert found.table["ratio"] < 0.85
    assert found.table["other_directions"]


def test_grain_that_keeps_its_direction_does_not() -> None:
    distance, *_ = river(3)
    found = measured(coloured(distance, grain(3, side=SIDE)), distance)
    assert found.table["chosen"] == ["plain"]
    assert found.table["ratio"] > 1.15


def test_what_has_no_direction_need_not() -> None:
    # its banks turn with the map, but control tells where they are
    distance, *_ = river(4)
    found = measured(coloured(distance, grain(4, along=1.2, side=SIDE)), distance)
    assert found.table["chosen"] == ["plain"]
    assert found.table["ratio"] == pytest.approx(1, abs=0.06)


def test_relief_lit_from_one_side_does_not() -> None:
    height = smooth_noise((SIDE, SIDE), 5, np.random.default_rng(5))
    down, across = np.gradient(height)
    assert measured(0.5 + 2 * (down + across), height).table["ratio"] > 1.1


def test_a_map_of_one_direction_tells_nothing() -> None:
    distance, rows, columns = river(6, amplitude=0.0)
    found = measured(coloured(distance, map_coordinates(grain(6), [rows, columns], order=1)), distance)
    assert found.table["chosen"] == ["plain"]


def test_what_was_asked_for_is_not_measured() -> None:
    noise = smooth_noise((SIDE, SIDE), 5, np.random.default_rng(7))
    assert measured(noise, noise, way="turned").table == {"chosen": ["turned"], "because": "it was asked for"}
    assert "cannot be measured" in measured(noise[:40], noise[:40]).table["because"]
    with pytest.raises(InputError, match="way: turned is not among plain"):
        measured(noise, noise, way="turned", labels=("plain",))


@pytest.mark.parametrize(
    ("params", "line"), [({"most": 1000}, "more than 1000 px"), ({"tileable": "x"}, "tileable")]
)
def test_what_turns_but_cannot_be_turned_is_said(params: dict[str, object], line: str) -> None:
    distance, rows, columns = river(8)
    grey = map_coordinates(grain(8), [rows, columns], order=1)
    found = measured(coloured(distance, grey), distance, **params)
    assert found.table["chosen"] == ["plain"]
    assert line in found.table["because"]


def test_a_tileable_result_is_not_turned() -> None:
    with pytest.raises(InputError, match="per_pixel_oriented"):
        measured(*river(9)[1::-1], way="turned", tileable="both")


def test_what_control_predicts_is_taken_away() -> None:
    random = np.random.default_rng(9)
    control = random.random((SIDE, SIDE, 2), np.float32)
    noise = 0.1 * random.normal(size=(SIDE, SIDE, 3))
    colours = (np.sin(4 * control[..., :1]) + control[..., 1:] ** 2) * [10, 20, 30] + noise
    left = unpredicted(colours.astype(np.float32), control)
    assert left.std() < 0.2
    assert colours.std() > 5


def test_the_way_that_was_taken() -> None:
    image: Image = picture(np.full((4, 4), 0.5))
    taken = either_way({"chosen": ["turned"], "because": "asked"}, turned=image, turned_notes=["One."])
    assert taken.image is image
    assert taken.notes == ["One.", "The texture turns with its control map: asked."]
    with pytest.raises(InputError, match="plain: was chosen, but is not there"):
        either_way({"chosen": ["plain"], "because": "asked"}, turned=image)
