"""What is plausible of files that do not say it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.synthetic import picture
from texloom.pipelines.media.plausibility import plausible_green, plausible_wraps
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Facts, MapFacts


def noise(sides: tuple[int, int] = (160, 192), blur: float = 3.0) -> np.ndarray:
    """A torus, 0..1."""
    values = gaussian_filter(np.random.default_rng(11).random(sides), blur, mode="wrap")
    return (values - values.min()) / np.ptp(values)


def verdicts(values: np.ndarray) -> dict[str, str]:
    return {axis: found["wraps"] for axis, found in plausible_wraps(picture(values)).items()}


def test_borders_of_tiles_and_of_parts() -> None:
    tile = noise()
    assert verdicts(tile) == {"x": "yes", "y": "yes"}
    assert verdicts(tile[:130]) == {"x": "yes", "y": "no"}
    assert verdicts(tile[:, 20:170]) == {"x": "no", "y": "yes"}
    assert verdicts(tile[10:, :150]) == {"x": "no", "y": "no"}


@pytest.mark.parametrize("shift", [0, 5])
def test_a_joint_at_the_border_is_no_seam(shift: int) -> None:
    """Bricks of 20 px: lines on both sides of a joint are unlike inside too."""
    wall = noise() * 0.2
    wall[np.arange(160) // 20 % 2 == 0] += 0.6
    assert "no" not in verdicts(np.roll(wall, shift, axis=0)).values()


def test_what_cannot_be_told_is_unclear() -> None:
    unclear = {"x": "unclear", "y": "unclear"}
    assert verdicts(np.random.default_rng(2).random((128, 128))) == unclear
    assert verdicts(np.full((128, 128), 0.5)) == unclear
    assert verdicts(noise((16, 16))) == unclear


def material(green: int = 1, depth: int = 1, said: str = "") -> Image:
    """Heights and their normals, whose file has green up (1) or down (-1)."""
    height = noise()
    down, across = (np.roll(height, -1, axis) - np.roll(height, 1, axis) for axis in (0, 1))
    normals = np.dstack([-8 * across, 8 * down * green * (-1 if said == "down" else 1), np.ones_like(height)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    planes = np.dstack([height, normals, height if depth > 0 else 1 - height]).astype(np.float32)
    names = ("Y", "normal.X", "normal.Y", "normal.Z", "height")
    return Image(planes, names, Facts(maps={"normal": MapFacts(green=said)}))


@pytest.mark.parametrize("depth", [1, -1])
@pytest.mark.parametrize(("green", "name"), [(1, "up"), (-1, "down")])
@pytest.mark.parametrize("said", ["", "up", "down"])
def test_green_is_told_by_the_slopes(green: int, name: str, depth: int, said: str) -> None:
    found = plausible_green(material(green, depth, said))
    assert found is not None
    assert (found["green"], found["height"]) == (name, "height" if depth > 0 else "depth")


def test_normals_of_another_surface() -> None:
    image = material()
    image.pixels[..., 4] = np.roll(image.pixels[..., 4], (50, 70), (0, 1))
    found = plausible_green(image)
    assert found is not None
    assert found["green"] == "does not fit the height"
    image.pixels[..., 4] = 0.5
    assert plausible_green(image) is None
    assert plausible_green(picture(noise())) is None
