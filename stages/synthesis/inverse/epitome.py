"""Epitomes: a small image of means and variances as a generative model of a texture's patches."""

import dataclasses

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.control import resize_control
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import row_product
from texloom.stages.synthesis.inverse.summary import SummaryParams, require_features, size_check, wanted_size
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.progress import Progress, report

_TILE = 256  # patches whose posteriors are held at a time
_MIN_WEIGHT = 1e-3  # sum of posteriors below which a pixel is not updated
_POSTERIOR_STEP = 2.0**-20
_STEP = 2.0**-12  # of 1 / variance, of mean / variance and of carried channels


class EpitomeParams(SummaryParams):
    """Size of the epitome, and the effort of learning it."""

    patch_size: int = Field(8, ge=2, le=32)
    """side of a patch, px; larger ones blur, smaller ones lose structure"""
    patches: int = Field(512, ge=64, le=1 << 16)
    """patches drawn from the texture in each iteration"""
    rounds: int = Field(16, ge=1, le=500)
    """iterations of expectation and maximisation"""
    least_deviation: float = Field(4.0, ge=1.0, le=50)
    """smallest standard deviation of a pixel, CIELAB units"""


@dataclasses.dataclass(frozen=True)
class Epitome:
    """The means of features and of carried channels."""

    image: Image
    """all channels of the texture: means by the last iteration's posteriors"""
    control: Image | None
    """the same of the control map; none without one"""
    planes: Float32[np.ndarray, "H W c"]
    """means of the features, CIELAB units"""
    deviation: ScalarMap
    """square root of the features' mean variance at each pixel, CIELAB units"""


class _Model:
    """Means and variances on a torus, and means of the carried channels.

    Operands of sums of products are multiples of small steps, so that sums are exact in any order.
    """

    def __init__(self, side: int, mean: np.ndarray, variance: np.ndarray, carried: np.ndarray):
        self.side, self.size = side, mean.shape[:2]
        self.mean, self.variance, self.carried = mean, variance, carried  # (H, W, c); (H, W, k) carried

    def learn(self, patches: np.ndarray, carried: np.ndarray, min_deviation: float) -> None:
        """One iteration with patches and their carried channels, one a row; [Jojic2003]_ (7) to (9)."""
        sparse = loaded("scipy.sparse")
        blocks = [self.posteriors(patches[first : first + _TILE]) for first in range(0, len(patches), _TILE)]
        shares = sparse.vstack([sparse.csr_array(block) for block in blocks]).T.tocsr()
        weight = self._accumulated(shares @ np.ones((len(patches), self.side**2)))
        covered = weight[..., 0] > _MIN_WEIGHT
        mean, square, further = (
            self._accumulated(shares @ part)[covered] / weight[covered] for part in (patches, patches**2, carried)
        )
        self.mean[covered], self.carried[covered] = mean, further
        self.variance[covered] = np.maximum(square - mean**2, min_deviation**2)

    def windows(self, planes: np.ndarray) -> np.ndarray:
        """The patches at all places, wrapped around, one a row."""
        extra = self.side - 1
        padded = np.pad(planes, ((0, extra), (0, extra), (0, 0)), mode="wrap")
        view = np.lib.stride_tricks.sliding_window_view(padded, (self.side, self.side), axis=(0, 1))
        return np.ascontiguousarray(view.transpose(0, 1, 3, 4, 2)).reshape(self.size[0] * self.size[1], -1)

    def posteriors(self, patches: np.ndarray) -> np.ndarray:
        """Posterior probability of each place for every patch, (n, H * W); [Jojic2003]_ (6)."""
        sharpness = np.rint(1 / self.variance / _STEP) * _STEP
        pull = np.rint(self.mean * sharpness / _STEP) * _STEP
        offset = self.windows(self.mean * pull + log(self.variance)).sum(axis=1)
        energy = (
            row_product(patches**2, self.windows(sharpness).T)
            - 2 * row_product(patches, self.windows(pull).T)
            + offset
        )
        shares = exp((energy.min(axis=1, keepdims=True) - energy) / 2)
        shares /= shares.sum(axis=1, keepdims=True)
        return np.asarray(np.rint(shares / _POSTERIOR_STEP) * _POSTERIOR_STEP)

    def _accumulated(self, values: np.ndarray) -> np.ndarray:
        """Sum patch values of every place, (H * W, side * side * k), over the pixels that they cover; (H, W, k)."""
        parts = values.reshape(*self.size, self.side, self.side, -1)
        total = np.zeros((*self.size, parts.shape[4]))
        for row in range(self.side):
            for column in range(self.side):
                total += np.roll(parts[:, :, row, column], (row, column), axis=(0, 1))
        return total


def _patches(planes: np.ndarray, rows: np.ndarray, columns: np.ndarray, side: int) -> np.ndarray:
    """Patches by their top-left pixels, one a row; (n, side * side * c)."""
    within = np.arange(side)
    down, across = rows[:, None, None] + within[:, None], columns[:, None, None] + within
    return np.asarray(planes[down, across].reshape(len(rows), -1), np.float64)


@stage(version=1, check=size_check("epitome", "patch_size"))
def epitome(
    texture: Image,
    features: Float32[np.ndarray, "h w c"],
    params: EpitomeParams,
    rng: np.random.Generator,
    control: Image | None = None,
    sides: list[int] | None = None,
) -> Epitome:
    """Learn an epitome of a texture's patches by expectation maximisation.

    Each pixel has a mean and a variance, from which the pixels of a patch are drawn. Iterations alternate between
    the posteriors of all places for some patches of the texture, and the means and variances of most likelihood.

    Parameters
    ----------
    texture : the large texture.
    features : planes that are learned, CIELAB units; see `control_features`.
    control : control map carried along; of any size of the same aspect ratio.
    sides : height and width of a compaction, px, used where ``params.size`` is null.

    Raises
    ------
    InputError
        no size is given, or it exceeds the texture's, or does not hold a patch.

    Notes
    -----
    Every iteration draws other patches; pixels that none of them covers are unchanged. The prior over places is
    uniform. The epitome is a torus, initialised with the texture's mean and noise of its standard deviation.

    References
    ----------
    [Jojic2003]_ sections 2 and 3.
    """
    require_features("epitome", features, texture)
    size = wanted_size("epitome", params.size, texture, sides, params.patch_size)
    side, channels = params.patch_size, features.shape[2]
    centre = features.mean(axis=(0, 1), dtype=np.float64)
    values = np.rint(features - centre)  # whole CIELAB units
    carried = texture.pixels
    if control is not None:
        resized = resize_control(control, texture.height, texture.width)
        carried = np.concatenate([carried, resized.pixels], axis=2)
    carried = np.rint(carried / _STEP) * _STEP
    spread = np.maximum(values.std(axis=(0, 1)), params.least_deviation)
    model = _Model(
        side,
        rng.normal(size=(*size, channels)) * spread,
        np.broadcast_to(spread**2, (*size, channels)).copy(),
        np.broadcast_to(carried.mean(axis=(0, 1)), (*size, carried.shape[2])).copy(),
    )
    corners = (texture.height - side + 1, texture.width - side + 1)

    def picture() -> Image:
        pixels = model.carried[..., : len(texture.channels)].astype(np.float32)
        return texture.elsewhere(pixels).wrapping(True)

    for done in range(1, params.rounds + 1):
        rows, columns = rng.integers(0, corners, (params.patches, 2)).T
        patches, further = (_patches(planes, rows, columns, side) for planes in (values, carried))
        model.learn(patches, further, params.least_deviation)
        report(Progress(done / params.rounds, iteration=done, iterations=params.rounds, preview=picture))
    shown = None
    if control is not None:
        pixels = np.ascontiguousarray(model.carried[..., len(texture.channels) :], np.float32)
        shown = control.elsewhere(pixels).wrapping(True)
    return Epitome(
        picture(),
        shown,
        np.asarray(model.mean + centre, np.float32),
        np.sqrt(model.variance.mean(axis=2)).astype(np.float32),
    )
