"""Initialisation of the optimisation: blocks of the exemplar, in phase with its lattice or its courses."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.synthesis.optimisation.block_layer import BlockLayer
from texloom.stages.synthesis.optimisation.block_sides import (
    block_margin,
    block_sides,
    sides_beside_mask,
)
from texloom.stages.synthesis.optimisation.guides import resize_target
from texloom.stages.synthesis.optimisation.several_exemplars import SeveralExemplars, largest_block
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, nearest_valid, valid_pixels, without_usable
from texloom.stages.vocabulary.scratch import bands, empty
from texloom.stages.vocabulary.sizes import Size

_MIN_SIDE = 10  # px of an exemplar's shorter side


class InitialiseParams(Params):
    """Size of the result, and what it is initialised from."""

    size: Size | None = (1024, 1024)
    """size of the result, px; null: that of the target's guide, or ``times`` the exemplar's, one of which it needs
    then"""
    times: float | None = Field(None, gt=0, le=16)
    """sides of the result relative to the exemplar's, where ``size`` is null and no guide tells it"""
    method: Literal["lattice", "blocks", "pixels"] = "lattice"
    """`lattice`: blocks displaced by whole lattice cells, or by whole courses and any distance along them, or
    `blocks` if there are neither; `blocks`: blocks from anywhere; `pixels`: random pixels, for comparison"""
    block: int | None = Field(None, ge=8)
    """minimum side of a block, px; null: an eighth of the exemplar's shorter side with a lattice of two dimensions
    or a guide, else a third, or less where most blocks of that size would contain masked pixels"""
    tries: int = Field(10, ge=1, le=100)
    """candidate blocks for each place with a lattice, of which the one that matches its neighbours best is taken"""
    margin: int | None = Field(None, ge=0, le=256)
    """overlap of a block with its neighbours in which they are compared, and maximum shift of the block, px; at
    most half its side; null: a quarter of its shorter side, at least 25"""


@dataclasses.dataclass(frozen=True)
class Initialised:
    """The initial result."""

    match: Correspondence
    """for every pixel of the result its source in the exemplar"""
    image: Image
    """the exemplar's pixels at ``match``"""


def check_exemplar(params: InitialiseParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must be large enough to cut blocks from."""
    image = known.get("image")
    if image is not None:
        check_side(image, _MIN_SIDE)


def _size(
    params: InitialiseParams, exemplar: tuple[int, int] | None, target: tuple[int, int] | None
) -> tuple[int, int]:
    """Height and width of the result, given those of the exemplar and of the target's guide."""
    size = params.size or target
    if size is None and params.times is not None and exemplar is not None:
        return max(1, round(params.times * exemplar[0])), max(1, round(params.times * exemplar[1]))
    if size is None:
        raise InputError("size: give the size of the result, or a guide that has it")
    return size


def outlines(params: InitialiseParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The correspondence has the size of the result."""
    image, target = known.get("image"), known.get("target_guide")
    if params.size is None and target is None and (params.times is None or image is None):
        return {}
    exemplar = None if image is None else (image.height, image.width)
    return {"match": Outline(*_size(params, exemplar, None if target is None else target.shape[:2]))}


@stage(version=2, check=check_exemplar, outlines=outlines, in_bands=True, exemplar_bytes=90)
def initialise(
    image: Image,
    params: InitialiseParams,
    rng: np.random.Generator,
    structure: Mask | None = None,
    generators: Vectors | None = None,
    exemplar_guide: Float32[np.ndarray, "h w k"] | None = None,
    target_guide: Float32[np.ndarray, "H W k"] | None = None,
    share: ScalarMap | None = None,
    rectangles: Rectangles | None = None,
) -> Initialised:
    """Cover the result with blocks of the exemplar.

    Blocks are laid in scan order and joined along minimum cuts. With a lattice every block is displaced by whole
    lattice steps from where the first block would continue, so that cells stay in phase across the whole result;
    little used parts of the exemplar are tried first, with small shifts. Without one it is the place, of all little
    used ones, that matches its neighbours best in colour and structure; with courses, of all those at whole courses
    from where the first block would continue. Under a guide it is one of the places whose guide is most like that
    of the result. Blocks avoid masked pixels, and without a lattice are smaller where few places would allow that;
    where it is impossible, each masked pixel is replaced by the nearest usable one.

    Parameters
    ----------
    image : the exemplar.
    structure : true on features, whose continuation is weighted highest; none compares colour alone.
    generators : the lattice, two rows of px, or one, at right angles to the courses; none or no rows where the
        exemplar has no lattice.
    exemplar_guide, target_guide : what lies where in the exemplar and what is to lie where in the result, CIELAB
        units; see `guide`. The target's is resized to the result, and NaN where it asks for nothing. None without a
        guide.
    share : use of each exemplar pixel that is wanted, relative to even use, above 0; none for even use.
    rectangles : of several exemplars in one picture, see `exemplar_sheet`; without a guide each gives its share of
        the blocks.

    Raises
    ------
    InputError
        the exemplar is smaller than 10 x 10 px; neither ``size`` nor a guide tells the result's.

    References
    ----------
    [Kaspar2015]_ section 3.3. The paper cuts blocks at multiples of a box around the generators, which preserves
    only lattices aligned with the axes; we displace by lattice steps, and compare by masked squared differences
    where its authors' code correlates. Cuts are those of [Kwatra2003]_. Cutting blocks, and searching everywhere
    without a lattice, are ours: discontinuities of the start are blurred at the coarsest scale and never repaired.
    """
    usable = valid_pixels(image)
    shape = (image.height, image.width)
    size = _size(params, shape, None if target_guide is None else (target_guide.shape[0], target_guide.shape[1]))
    if params.method == "pixels":
        match = rng.integers(0, shape, (*size, 2), dtype=np.int64).astype(np.uint32)
    else:
        lattice = np.zeros((0, 2), np.float32)
        if generators is not None and params.method == "lattice":
            lattice = generators
        guides = None
        if exemplar_guide is not None and target_guide is not None:
            guides = exemplar_guide, resize_target(target_guide, *size)
        sides = block_sides(shape, lattice, params.block, guides is not None)
        if usable is not None and len(lattice) < 2 and params.block is None:
            sides = sides_beside_mask(sides, usable, params.margin)
        filled = fill_excluded(image).color
        features = np.empty((*shape, 4), np.float32)
        for band in bands(shape[0]):
            features[band, :, :3] = lab_from_linear(filled[band])
            features[band, :, 3] = 0 if structure is None else structure[band] * np.float32(100)
        del filled
        if rectangles is not None and params.block is None:
            largest = largest_block(rectangles, size)
            sides = min(sides[0], largest), min(sides[1], largest)
        several = None
        if rectangles is not None and guides is None:
            several = SeveralExemplars.of(rectangles, usable, share, shape)
        margin = block_margin(sides, params.margin)
        layer = BlockLayer(
            features, lattice, sides, margin, size, params.tries, rng, usable, guides, share, several
        )
        match = layer.run()
    nearest = None if usable is None else nearest_valid(usable)
    image = without_usable(image)
    pixels = empty((*size, image.pixels.shape[2]), np.float32)
    for band in bands(size[0], match, pixels):
        if nearest is not None:
            match[band] = np.moveaxis(nearest[:, match[band, :, 0], match[band, :, 1]], 0, 2)
        pixels[band] = image.pixels[match[band, :, 0], match[band, :, 1]]
    return Initialised(match, image.elsewhere(pixels))
