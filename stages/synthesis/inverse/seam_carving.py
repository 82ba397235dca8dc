"""Seam carving: an image is reduced by removing the seams of least energy."""

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.synthesis.inverse.summary import (
    Copied,
    SummaryParams,
    require_features,
    size_check,
    wanted_size,
)
from texloom.stages.synthesis.stitching.cuts import cheapest_path
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.progress import Progress, report


class SeamCarvingParams(SummaryParams):
    """Size of the result, and the order of seams."""

    rounds: int = Field(32, ge=1, le=1024)
    """number of alternations between removing columns and rows"""


@stage(version=1, check=size_check("seam_carving"))
def seam_carving(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: SeamCarvingParams,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Copied:
    """Remove the seam of least energy from a texture until it has the requested size.

    Parameters
    ----------
    texture : the large texture.
    features : planes from which the energy is computed, CIELAB units; see `control_features`.
    control : control map carved with the texture; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, used where ``params.size`` is null.

    Raises
    ------
    InputError
        no size is given, or it exceeds the texture's.

    Notes
    -----
    A pixel's energy is the sum over all features of the absolute differences between its horizontal and between its
    vertical neighbours (e1 of the paper). The paper finds the optimal order of columns and rows by dynamic
    programming; here they alternate.

    References
    ----------
    [Avidan2007]_ sections 3 and 4.1.
    """
    require_features("seam_carving", features, texture)
    size = wanted_size("seam_carving", params.size, texture, sides)
    pixels = fixed_point(features).reshape(features.shape)
    number = np.arange(texture.height * texture.width, dtype=np.int32).reshape(texture.height, texture.width)
    full = number.shape
    for done in range(1, params.rounds + 1):
        height, width = (
            start + (end - start) * done // params.rounds for start, end in zip(full, size, strict=True)
        )
        pixels, number = _narrowed(pixels, number, width)
        pixels, number = _narrowed(pixels, number, height)
        report(Progress(done / params.rounds, iteration=done, iterations=params.rounds))
    return Copied.of(texture, control, np.stack(np.divmod(number, texture.width), axis=2))


def _narrowed(pixels: np.ndarray, number: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Both with seams removed until ``width`` columns remain, and transposed, so that rows are next."""
    from texloom.stages.kernels.seams.carving import close_seam, gradient_energy

    for columns in range(number.shape[1], width, -1):
        errors = np.empty((number.shape[0], columns), np.float32)
        gradient_energy(pixels, errors)
        close_seam(pixels, number, cheapest_path(errors), columns)
    transposed = pixels[:, :width].transpose(1, 0, 2)
    return np.ascontiguousarray(transposed), np.ascontiguousarray(number[:, :width].T)
