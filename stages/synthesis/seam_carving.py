"""Seam carving: a picture made small by taking out what is seen least."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.common.neighbourhoods import fixed_point
from texloom.stages.declare import Params, stage
from texloom.stages.progress import Progress, report
from texloom.stages.synthesis._compaction.summary import Copied, require_features, wanted_size
from texloom.stages.synthesis._seams.cuts import cheapest_path


class SeamCarvingParams(Params):
    """How small, and in which order."""

    size: tuple[int, int] | None = None
    """height and width of the result, px; null: ``sides``"""
    rounds: int = Field(32, ge=1, le=1024)
    """times that columns and then rows are taken out, a share of them each time"""


def check_carving(params: SeamCarvingParams, known: Mapping[str, Any]) -> None:
    """The result must not be larger than the texture."""
    texture = known.get("texture")
    if texture is not None and params.size is not None:
        wanted_size("seam_carving", params.size, texture, None)


@stage(version=1, check=check_carving)
def seam_carving(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: SeamCarvingParams,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Take seams out of a texture until it is small, each the one along which it changes least.

    Parameters
    ----------
    features : what is looked at, CIELAB units; see `control_features`.
    control : carved with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, that the result is to have too.

    Raises
    ------
    InputError
        no size is known, or it is beyond the texture's.

    Notes
    -----
    A pixel's energy is the sum over all features of the absolute differences between its neighbours, across and
    down (e1 of the paper). The paper finds the best order of columns and rows by dynamic programming over all
    orders; here they take turns.

    References
    ----------
    [Avidan2007]_ sections 3 and 4.1.
    """
    require_features("seam_carving", features, texture)
    wanted = wanted_size("seam_carving", params.size, texture, sides)
    pixels = fixed_point(features).reshape(features.shape)
    number = np.arange(texture.height * texture.width, dtype=np.int32).reshape(texture.height, texture.width)
    started = number.shape
    for done in range(1, params.rounds + 1):
        left = [start + (end - start) * done // params.rounds for start, end in zip(started, wanted, strict=True)]
        pixels, number = _narrowed(pixels, number, left[1])
        pixels, number = _narrowed(pixels, number, left[0])
        report(Progress(done / params.rounds, iteration=done, iterations=params.rounds))
    return Copied.of(texture, control, np.stack(np.divmod(number, texture.width), axis=2))


def _narrowed(pixels: np.ndarray, number: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """With seams taken out until ``width`` columns are left; transposed, so that rows are next."""
    from texloom.stages.kernels.seams.carving import close_seam, steepness

    for columns in range(number.shape[1], width, -1):
        errors = np.empty((number.shape[0], columns), np.float32)
        steepness(pixels, errors)
        close_seam(pixels, number, cheapest_path(errors), columns)
    turned = pixels[:, :width].transpose(1, 0, 2)
    return np.ascontiguousarray(turned), np.ascontiguousarray(number[:, :width].T)
