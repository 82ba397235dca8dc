"""How much of what does not belong to a surface is masked, and how much of the surface is kept, of five scenes.

    python -m benchmarks.occluded_surfaces

Drawn are, with known truth: a tiled floor with a rug, a roof of shingles with a chimney, asphalt with a lane
marking, a fence with a gap, and shelves beside a post. All are seen from the front; `foreign_parts` judges them.
"""

import logging

import numpy as np

from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.analysis.regularity.offset_statistics import OffsetStatisticsParams, offset_statistics
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (300, 400)
Scene = tuple[np.ndarray, np.ndarray]
"""light, and what belongs to the surface"""


def _rough(random: np.random.Generator, deviation: float, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    noise = gaussian_blur(random.normal(size=shape).astype(np.float32), deviation)
    return np.asarray(noise / noise.std())


def _tinted(grey: np.ndarray, tint: tuple[float, float, float]) -> np.ndarray:
    return np.asarray(grey[..., None] * np.array(tint))


def _cells(random: np.random.Generator, high: int, wide: int, spread: float, bond: int = 0) -> np.ndarray:
    """Grey of tiles with dark joints, of which every second row is moved."""
    rows, columns = np.indices(SHAPE)
    columns = columns + bond * (rows // high % 2)
    tones = random.normal(0.45, spread, (SHAPE[0] // high + 1, (SHAPE[1] + bond) // wide + 1))
    joint = (rows % high < 3) | (columns % wide < 3)
    return np.where(joint, 0.15, tones[rows // high, columns // wide]) * (1 + 0.04 * _rough(random, 1.5))


def _put(light: np.ndarray, what: np.ndarray, where: tuple[slice, slice]) -> Scene:
    belongs = np.ones(SHAPE, np.bool_)
    belongs[where] = False
    return np.where(belongs[..., None], light, what), belongs


def floor_with_rug(random: np.random.Generator) -> Scene:
    """Pale tiles, and a red rug with a weave."""
    rows, columns = np.indices(SHAPE)
    weave = 0.2 + 0.1 * ((rows // 6 + columns // 6) % 2)
    return _put(_tinted(_cells(random, 40, 40, 0.03), (1, 0.95, 0.85)), _tinted(weave, (1, 0.2, 0.2)),
                (slice(110, 220), slice(120, 290)))  # fmt: skip


def roof_with_chimney(random: np.random.Generator) -> Scene:
    """Shingles in a bond, and a chimney of smooth plaster."""
    return _put(_tinted(_cells(random, 20, 30, 0.05, 15), (1, 0.55, 0.4)),
                _tinted(0.7 * (1 + 0.05 * _rough(random, 3)), (0.9, 0.95, 1)),
                (slice(40, 150), slice(230, 300)))  # fmt: skip


def asphalt_with_marking(random: np.random.Generator) -> Scene:
    """Rough asphalt, and a white line along it."""
    grey = 0.1 * (1 + 0.25 * _rough(random, 1))
    return _put(_tinted(grey, (1, 1, 1.05)), _tinted(0.7 * (1 + 0.03 * _rough(random, 2)), (1, 1, 0.95)),
                (slice(0, SHAPE[0]), slice(290, 325)))  # fmt: skip


def fence_with_a_gap(random: np.random.Generator) -> Scene:
    """Boards, of which one is missing, before leaves."""
    boards = np.arange(SHAPE[1]) % 50
    grain = 0.35 * (1 + 0.15 * _rough(random, 1)[:1] + 0.05 * _rough(random, 2))
    tones = random.normal(1, 0.06, SHAPE[1] // 50 + 1)[np.arange(SHAPE[1]) // 50]
    wood = _tinted(np.where(boards < 4, 0.03, grain * tones), (1, 0.75, 0.5))
    green = _tinted(0.12 * np.clip(1 + 0.6 * _rough(random, 2), 0.1, None), (0.5, 1, 0.3))
    return _put(wood, green, (slice(0, SHAPE[0]), slice(154, 200)))


def shelves_beside_a_post(random: np.random.Generator) -> Scene:
    """Jars on shelves, and a post at the side."""
    rows, columns = np.indices(SHAPE)
    jar = np.hypot((columns % 25 - 12) / 11, (rows % 50 - 28) / 18) < 1
    tones = random.uniform(0.2, 0.6, (SHAPE[0] // 50 + 1, SHAPE[1] // 25 + 1))[rows // 50, columns // 25]
    grey = np.where(rows % 50 < 5, 0.5, np.where(jar, tones, 0.06))
    return _put(_tinted(grey, (1, 0.8, 0.6)), _tinted(0.8 * (1 + 0.02 * _rough(random, 3)), (0.9, 0.95, 1)),
                (slice(0, SHAPE[0]), slice(0, 45)))  # fmt: skip


def main() -> None:
    """Print the shares of each scene."""
    logging.getLogger("texloom").setLevel(logging.ERROR)
    scenes = floor_with_rug, roof_with_chimney, asphalt_with_marking, fence_with_a_gap, shelves_beside_a_post
    print(f"{'':26}{'foreign masked':>15}{'surface kept':>14}  evenness")
    for number, make in enumerate(scenes):
        random = np.random.default_rng(number)
        light, belongs = make(random)
        noisy = np.clip(light + random.normal(0, 0.004, light.shape), 0, 1).astype(np.float32)
        image = Image(noisy, ("R", "G", "B"))
        density = offset_statistics(image, OffsetStatisticsParams()).density
        generators = lattice_selection(image, density, LatticeSelectionParams()).generators
        try:
            made = foreign_parts(image, ForeignPartsParams(), generators=generators)
        except InputError as error:
            print(f"{make.__name__:26}refused: {str(error)[:70]}", flush=True)
            continue
        kept = made.mask.color[..., 0] > 0.5
        shares = f"{1 - kept[~belongs].mean():15.0%}{kept[belongs].mean():14.0%}"
        print(f"{make.__name__:26}{shares}  {made.table['evenness']:.2f} {made.table['doubt'][:50]}", flush=True)


if __name__ == "__main__":
    main()
