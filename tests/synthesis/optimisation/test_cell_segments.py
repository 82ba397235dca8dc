import numpy as np
import pytest

from tests.synthesis.optimisation.test_cells import GENERATORS, HEIGHT, WIDTH, wall
from texloom.stages.synthesis.optimisation.cell_segments import segments_of, unlikeness


@pytest.mark.parametrize("kind", ["grid", "bond"])
def test_a_tile_is_one_part_between_its_joints(kind: str, rng: np.random.Generator) -> None:
    lab, generators = wall(kind, rng), GENERATORS[kind]
    segments = segments_of(lab, *unlikeness(lab, generators), generators)
    assert segments is not None
    assert segments.count == 1
    rows, columns = np.indices((4 * HEIGHT, 4 * WIDTH))
    positions = np.einsum("kij,kl->lij", np.stack([rows, columns]), np.linalg.inv(generators.astype(np.float64)))
    cell, _ = segments(positions + 1e-6)
    row = rows // HEIGHT
    shifted = columns - row * int(generators[0, 1])
    inside = (
        (rows % HEIGHT > 2) & (shifted % WIDTH > 2) & (rows % HEIGHT < HEIGHT - 1) & (shifted % WIDTH < WIDTH - 1)
    )
    own = row * 100 + shifted // WIDTH
    for tile in np.unique(own[inside]):
        assert len(np.unique(cell[:, inside & (own == tile)], axis=1).T) == 1


def test_noise_and_stripes_have_none(rng: np.random.Generator) -> None:
    generators = GENERATORS["grid"]
    noise = rng.uniform(20, 80, (8 * HEIGHT, 8 * WIDTH, 3)).astype(np.float32)
    stripes = np.zeros_like(noise)
    stripes[np.arange(8 * HEIGHT) % HEIGHT < 4] = 50
    for lab in (noise, stripes):
        assert segments_of(lab, *unlikeness(lab, generators), generators) is None
