"""One level of inverse texture synthesis along an orientation field; matches are found by exhaustive search."""

import numpy as np
from jaxtyping import Float32, Int16

from texloom.stages.arrays import ScalarMap
from texloom.stages.common.neighbourhoods import UNIT, Components, fixed_point, places
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.synthesis.inverse.level import Source, nearest

_PIECES = 16  # spans that threads share
_SAMPLE = 20000  # neighbourhoods that the components are fitted to, about


class OrientedLevel:
    """A compaction of a texture whose neighbourhoods are sampled in frames along its orientation field.

    Parameters
    ----------
    alpha, seams : weights of the forward term and of seams; see `compact`.

    Attributes
    ----------
    angle : of the frame at every texture pixel, radians, see `texloom.stages.kernels.compaction.oriented`.
    source : texture pixel of each compaction pixel, (2, H, W).
    places : middles of the texture's neighbourhoods in the inverse term, one a row.
    inverse : number of the compaction's neighbourhood that each of those is matched with.
    forward : number of the one of those that each neighbourhood of the compaction is matched with.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        angle: ScalarMap,
        source: Source,
        size: int,
        spacing: int,
        alpha: float,
        seams: float,
    ):
        self.channels, self.size, self.alpha, self.seams = features.shape[2], size, alpha, seams
        self.pixels = fixed_point(features)
        middle = size // 2
        rows = np.arange(middle, features.shape[0] - middle, spacing)
        columns = np.arange(middle, features.shape[1] - middle, spacing)
        self.grid = (rows.size, columns.size)
        self.places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=2).reshape(-1, 2).astype(np.int32)
        self.down, self.across = places(source.shape[1], source.shape[2], size)
        self.source: Source = np.ascontiguousarray(source)
        self.values = self._copied()
        self.set_orientation(angle)

    def set_orientation(self, angle: ScalarMap) -> None:
        """Replace the orientation field and search all matches again."""
        from texloom.stages.kernels.compaction.oriented import oriented_windows

        self.angle = np.ascontiguousarray(angle)
        place_angles = self.angle[self.places[:, 0], self.places[:, 1]]
        self.windows = np.empty((len(self.places), self.size**2 * self.channels), np.int16)
        shared = (self.pixels, self.channels, self.places, place_angles, self.size, self.windows)
        run_spans(oriented_windows, shared, len(self.places), _PIECES)
        step = max(1, len(self.windows) // _SAMPLE)
        sample = self.windows[::step].astype(np.float64)
        self.components = Components.of_sample(sample, self.channels, self.size)
        self.vectors = self.components.projected(self.windows)
        self.inverse = np.zeros(len(self.places), np.int64)
        self.forward = np.zeros(self.down * self.across, np.int64)
        self.match()

    def _copied(self) -> Int16[np.ndarray, "H Wc"]:
        planes = self.pixels.reshape(self.pixels.shape[0], -1, self.channels)[self.source[0], self.source[1]]
        return np.ascontiguousarray(planes.reshape(planes.shape[0], -1))

    def _own_windows(self) -> Int16[np.ndarray, "n values"]:
        """The compaction's neighbourhoods, which are aligned with its pixels."""
        planes = self.values.reshape(self.values.shape[0], -1, self.channels)
        view = np.lib.stride_tricks.sliding_window_view(planes, (self.size, self.size), axis=(0, 1))
        return np.ascontiguousarray(view.transpose(0, 1, 3, 4, 2)).reshape(self.down * self.across, -1)

    def match(self) -> None:
        """Search the best match of every neighbourhood in both directions; a better previous match is kept."""
        own = self._own_windows()
        vectors = self.components.projected(own)
        proposed = nearest(self.vectors, vectors)
        self.inverse, self.inverse_distance = _better(self.windows, own, proposed, self.inverse)
        proposed = nearest(vectors, self.vectors)
        self.forward, self.forward_distance = _better(own, self.windows, proposed, self.forward)

    def energy(self) -> tuple[float, float, float]:
        """Inverse, forward and seam term, weighted, squared CIELAB units per pixel; see `compact`."""
        from texloom.stages.kernels.compaction.oriented import Texture, oriented_seam_sum

        unit = UNIT**2 * self.size**2
        inverse = float(self.inverse_distance.mean()) / unit
        forward = self.alpha * float(self.forward_distance.mean()) / unit
        visible = oriented_seam_sum(Texture(self.pixels, self.channels, self.angle), self.source)
        return inverse, forward, self.seams * visible / (2 * UNIT**2 * self.source[0].size)

    def choose(self) -> int:
        """Copy to every pixel the candidate that lowers the energy most; the number of pixels that changed."""
        from texloom.stages.kernels.compaction.oriented import Texture, choose_oriented_pixels
        from texloom.stages.kernels.compaction.solver import Objective

        wanted, weights = self._mean_votes()
        seam_weight = np.float32(self.seams * self.size**2 / (2 * weights.size))
        new = self.source.copy()
        objective = Objective(wanted, weights, seam_weight, False)
        choose_oriented_pixels(Texture(self.pixels, self.channels, self.angle), objective, self._proposed(), new)
        changed = int((new != self.source).any(axis=0).sum())
        self.source = new
        self.values = self._copied()
        return changed

    def _mean_votes(self) -> tuple[Float32[np.ndarray, "H W c"], Float32[np.ndarray, "H W"]]:
        """The weighted mean of all values matched with each pixel, and the sum of the weights."""
        height, width = self.source.shape[1:]
        total = np.zeros((height * width, self.channels))
        weight = np.zeros(height * width)
        voters = [
            (self.inverse, self.windows, 1 / len(self.windows)),
            (np.arange(self.forward.size), self.windows[self.forward], self.alpha / self.forward.size),
        ]
        for place, windows, share in voters:
            row, column = np.divmod(place, self.across)
            values = windows.reshape(len(windows), self.size, self.size, self.channels)
            for i, j in np.ndindex(self.size, self.size):
                at = (row + i) * width + column + j
                weight += share * np.bincount(at, minlength=weight.size)
                for k in range(self.channels):
                    total[:, k] += share * np.bincount(at, values[:, i, j, k], weight.size)
        mean = (total / weight[:, None]).astype(np.float32)
        return mean.reshape(height, width, self.channels), weight.reshape(height, width).astype(np.float32)

    def _proposed(self) -> np.ndarray:
        """Two candidate texture pixels for every compaction pixel, (2, 2, H, W); negative where there is none.

        The middles of the forward match and of the nearest inverse match of the neighbourhood around the pixel.
        """
        closest = np.full(self.forward.size, -1)
        order = np.argsort(-self.inverse_distance, kind="stable")
        closest[self.inverse[order]] = order
        middle = self.size // 2
        proposed = np.full((2, 2, *self.source.shape[1:]), -1, np.int32)
        inner = (slice(middle, middle + self.down), slice(middle, middle + self.across))
        for number, match in enumerate((self.forward, closest)):
            sources = np.where((match >= 0)[:, None], self.places[match], -1)
            proposed[number, :, *inner] = np.moveaxis(sources.reshape(self.down, self.across, 2), 2, 0)
        return proposed

    def best_angles(self, mean: np.ndarray, samples: int, rounds: int) -> np.ndarray:
        """For each place the angle near ``mean`` at which the compaction matches its neighbourhood best.

        Both float32 radians, one a place.
        """
        from texloom.stages.kernels.compaction.oriented import AngleSearch, refine_angles

        angles = np.empty(len(self.places), np.float32)
        match = np.ascontiguousarray(np.stack(np.divmod(self.inverse, self.across), axis=1).astype(np.int32))
        shared = (
            self.pixels, self.channels, self.values, AngleSearch(np.pi / 2, samples, rounds), self.places, match,
            mean, self.size, angles,
        )  # fmt: skip
        run_spans(refine_angles, shared, len(self.places), _PIECES)
        return angles


def _better(
    windows: np.ndarray, others: np.ndarray, proposed: np.ndarray, current: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nearer of two matches of each row among the others, and its squared distance."""
    distance, current_distance = (_distances(windows, others[match]) for match in (proposed, current))
    return np.where(distance < current_distance, proposed, current), np.minimum(distance, current_distance)


def _distances(windows: np.ndarray, others: np.ndarray) -> np.ndarray:
    difference = windows.astype(np.int32) - others
    # Integers below 2^53, so that sums are exact in any order.
    squares: np.ndarray = np.einsum("ij,ij->i", difference, difference, dtype=np.float64)
    return squares
