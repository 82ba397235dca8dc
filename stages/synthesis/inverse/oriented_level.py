"""One level of inverse texture synthesis along an orientation field; matches are found by exhaustive search."""

import numpy as np
from jaxtyping import Float32, Int16

from texloom.stages.common.similarity.neighbourhoods import UNIT, Components, fixed_point, places
from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.synthesis.inverse.level import nearest
from texloom.stages.synthesis.reconstruction.oriented_places import Places
from texloom.stages.vocabulary.arrays import ScalarMap

_PIECES = 16  # spans that threads share
_SAMPLE = 4096  # neighbourhoods that the components are fitted to, about


class OrientedLevel:
    """A compaction of a texture whose neighbourhoods are sampled in frames along its orientation field.

    Parameters
    ----------
    alpha, seams : weights of the forward term and of seams; see `compact`.

    Attributes
    ----------
    angle : of the frame at every texture pixel, radians, see `texloom.stages.kernels.compaction.oriented`.
    source : place between the texture's pixels that each compaction pixel is interpolated at, (2, H, W).
    places : middles of the texture's neighbourhoods in the inverse term, one a row.
    inverse : number of the compaction's neighbourhood that each of those is matched with.
    forward : number of the one of those that each neighbourhood of the compaction is matched with.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        angle: ScalarMap,
        source: Places,
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
        self.source: Places = np.ascontiguousarray(source)
        self.values = np.empty((source.shape[1], source.shape[2] * self.channels), np.int16)
        self.set_orientation(angle)

    def set_orientation(self, angle: ScalarMap) -> None:
        """Replace the orientation field and search all matches again."""
        from texloom.stages.kernels.compaction.oriented import OrientedTexture, oriented_windows, sample_sources

        self.angle = np.ascontiguousarray(angle)
        self.texture = OrientedTexture(self.pixels, self.channels, self.angle)
        run_spans(sample_sources, (self.texture, self.source, self.values), len(self.values), _PIECES)
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

    def _own_windows(self) -> Int16[np.ndarray, "n values"]:
        """The compaction's neighbourhoods, which are aligned with its pixels."""
        planes = self.values.reshape(self.values.shape[0], -1, self.channels)
        view = np.lib.stride_tricks.sliding_window_view(planes, (self.size, self.size), axis=(0, 1))
        return np.ascontiguousarray(view.transpose(0, 1, 3, 4, 2)).reshape(self.down * self.across, -1)

    def match(self, search: bool = True) -> None:
        """Compare what is matched anew, after a search of all neighbourhoods; a better previous match is kept."""
        own = self._own_windows()
        inverse, forward = self.inverse, self.forward
        if search:
            vectors = self.components.projected(own)
            inverse, forward = nearest(self.vectors, vectors), nearest(vectors, self.vectors)
        self.inverse, self.inverse_distance = _better(self.windows, own, inverse, self.inverse)
        self.forward, self.forward_distance = _better(own, self.windows, forward, self.forward)

    def energy(self) -> tuple[float, float, float]:
        """Inverse, forward and seam term, weighted, squared CIELAB units per pixel; see `compact`."""
        from texloom.stages.kernels.compaction.oriented import oriented_seam_sum

        unit = UNIT**2 * self.size**2
        inverse = float(self.inverse_distance.mean()) / unit
        forward = self.alpha * float(self.forward_distance.mean()) / unit
        visible = oriented_seam_sum(self.texture, self.source, self.values)
        return inverse, forward, self.seams * visible / (2 * UNIT**2 * self.source[0].size)

    def choose(self) -> int:
        """Move each pixel's source to the candidate that lowers the energy most; how many have moved."""
        from texloom.stages.kernels.compaction.oriented import choose_oriented_places
        from texloom.stages.kernels.compaction.solver import Objective

        wanted, weights = self._mean_votes()
        seam_weight = np.float32(self.seams * self.size**2 / (2 * weights.size))
        before = self.source.copy()
        objective = Objective(wanted, weights, seam_weight, False)
        choose_oriented_places(self.texture, objective, self._proposed(), self.source, self.values)
        return int((self.source != before).any(axis=0).sum())

    def _mean_votes(self) -> tuple[Float32[np.ndarray, "H W c"], Float32[np.ndarray, "H W"]]:
        """The weighted mean of all values matched with each pixel, and the sum of the weights."""
        from texloom.stages.kernels.compaction.oriented import add_votes

        shape = self.source.shape[1:]
        total, weight = np.zeros(self.values.shape), np.zeros(shape)
        voters = [
            (self.inverse, self.windows, 1 / len(self.windows)),
            (np.arange(self.forward.size), self.windows[self.forward], self.alpha / self.forward.size),
        ]
        for match, windows, share in voters:
            sums, votes = np.zeros(self.values.shape, np.int64), np.zeros(shape, np.int64)
            add_votes(windows, match, self.size, sums, votes)
            total += share * sums
            weight += share * votes
        mean = total.reshape(*shape, self.channels) / weight[..., None]
        return mean.astype(np.float32), weight.astype(np.float32)

    def _proposed(self) -> np.ndarray:
        """Two candidate places in the texture for each pixel, (2, 2, H, W); negative where there is none.

        The middles of the forward match and of the nearest inverse match of the neighbourhood around the pixel.
        """
        closest = np.full(self.forward.size, -1)
        order = np.argsort(-self.inverse_distance, kind="stable")
        closest[self.inverse[order]] = order
        middle = self.size // 2
        proposed = np.full((2, 2, *self.source.shape[1:]), -1, np.float32)
        inner = (slice(middle, middle + self.down), slice(middle, middle + self.across))
        for number, match in enumerate((self.forward, closest)):
            sources = np.where((match >= 0)[:, None], self.places[match], -1)
            proposed[number, :, *inner] = np.moveaxis(sources.reshape(self.down, self.across, 2), 2, 0)
        return proposed

    def best_angles(
        self, chosen: np.ndarray, mean: np.ndarray, samples: int, rounds: int, within: int
    ) -> np.ndarray:
        """For some places the angle near ``mean`` at which the compaction matches their neighbourhoods best.

        Parameters
        ----------
        chosen : numbers of the places.
        mean : (n,) float32, radians, one for each of them, as is the result.
        samples, rounds, within : see `texloom.stages.kernels.compaction.oriented.AngleSearch`.
        """
        from texloom.stages.kernels.compaction.oriented import AngleSearch, refine_angles

        angles = np.empty(len(chosen), np.float32)
        match = np.stack(np.divmod(self.inverse[chosen], self.across), axis=1).astype(np.int32)
        shared = (
            self.pixels, self.channels, self.values, AngleSearch(np.pi / 2, samples, rounds, within),
            self.places[chosen], match, mean, self.size, angles,
        )  # fmt: skip
        run_spans(refine_angles, shared, len(chosen), _PIECES)
        return angles


def _better(
    windows: np.ndarray, others: np.ndarray, proposed: np.ndarray, current: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nearer of two matches of each row among the others, and its squared distance."""
    current_distance = _distances(windows, others, current)
    if proposed is current:
        return current, current_distance
    distance = _distances(windows, others, proposed)
    return np.where(distance < current_distance, proposed, current), np.minimum(distance, current_distance)


def _distances(windows: np.ndarray, others: np.ndarray, match: np.ndarray) -> np.ndarray:
    from texloom.stages.kernels.compaction.oriented import matched_distances

    squares = np.empty(len(windows))
    run_spans(matched_distances, (windows, others, match, squares), len(windows), _PIECES)
    return squares
