"""k-coherence candidates of an exemplar, computed on demand."""

import numpy as np
from jaxtyping import Float32, Float64, Int32

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import eigenvectors, matrix_product, square_sums

_WINDOW = 7  # px, side of the neighbourhoods that are compared
_DIMENSIONS = 8  # principal components, which hold about nine tenths of the variance
_SAMPLE = 5000  # neighbourhoods that the components are fitted to, about
_MAX_INDEXED = 1 << 17  # neighbourhoods in the index, about
_BLOCK = 12  # indexed neighbourhoods computed at once, down and across; adjacent ones are needed soon
_PIECES = 4  # spans that threads share

NONE, UNKNOWN = -1, -2
"""in `SimilarPlaces.places`: there is no candidate; not computed yet"""


class SimilarPlaces:
    """For each pixel others with similar neighbourhoods, the most similar first.

    Pixels near the border, whose neighbourhood is not whole, have none. The search among principal components is
    approximate; large exemplars are indexed at every second or third pixel, and pixels between take the shifted
    candidates of the nearest indexed one. Results do not depend on the order of requests.

    References
    ----------
    [Tong2002]_ section 4.
    """

    places: Int32[np.ndarray, "h w k 2"]
    """rows and columns of the candidates, `NONE` or `UNKNOWN`"""

    def __init__(self, features: Float32[np.ndarray, "h w c"], count: int):
        spatial = loaded("scipy.spatial")
        height, width, _ = features.shape
        self.places = np.full((height, width, count, 2), NONE, np.int32)
        down, across = height - _WINDOW + 1, width - _WINDOW + 1
        if min(down, across) < 1 or count == 0 or down * across <= count:
            return
        margin = _WINDOW // 2
        self.inner = self.places[margin : margin + down, margin : margin + across]
        self.inner[:] = UNKNOWN
        self.vectors = _projected(features)
        self.stride = int(np.ceil(np.sqrt(down * across / _MAX_INDEXED)))
        indexed = self.vectors[:: self.stride, :: self.stride]
        self.shape = indexed.shape[:2]
        self.tree = spatial.cKDTree(indexed.reshape(-1, indexed.shape[2]), balanced_tree=False)

    def look_up(self, row: int, column: int) -> None:
        """Compute the candidates of a pixel, and of the block around it."""
        block, margin = _BLOCK * self.stride, _WINDOW // 2
        tops = (row - margin) // block * block, (column - margin) // block * block
        lines = [np.arange(top, min(top + block, side)) for top, side in zip(tops, self.inner.shape, strict=False)]
        indexed = [
            np.minimum((line + self.stride // 2) // self.stride, side - 1)
            for line, side in zip(lines, self.shape, strict=True)
        ]
        (first_row, first_column), (rows, columns) = (line[0] for line in indexed), indexed
        block_places = np.mgrid[first_row : rows[-1] + 1, first_column : columns[-1] + 1]
        candidates = self._nearest(block_places.reshape(2, -1).T).reshape(*block_places.shape[1:], -1, 2)
        of_pixels = candidates[np.ix_(rows - first_row, columns - first_column)]
        steps = np.stack(np.meshgrid(*(lines[k] - indexed[k] * self.stride for k in (0, 1)), indexing="ij"), axis=2)
        places = np.clip(of_pixels + steps[:, :, None], 0, np.array(self.inner.shape[:2]) - 1)
        self.inner[np.ix_(*lines)] = places + margin

    def _nearest(self, own: np.ndarray) -> Int32[np.ndarray, "n k 2"]:
        """Places of the approximate nearest neighbours of some indexed places, which are not among them."""
        from texloom.stages.kernels.core.threads import run_spans, thread_count
        from texloom.stages.kernels.kcoherence.local_search import search_around

        count = self.places.shape[2]
        wanted = self.vectors[own[:, 0] * self.stride, own[:, 1] * self.stride]
        numbers = self.tree.query(wanted, k=count + 1, eps=1.0, workers=thread_count())[1]
        # Each place finds itself, not always first if others are equal.
        others = numbers != matrix_product(own, [self.shape[1], 1])[:, None]
        others[others.all(axis=1), -1] = False
        places = np.stack(np.divmod(numbers[others].reshape(-1, count), self.shape[1]), axis=-1) * self.stride
        places = places.astype(np.int32)
        if self.stride > 1:
            run_spans(search_around, (self.vectors, own * self.stride, places, self.stride - 1), len(own), _PIECES)
        return places


def _projected(features: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "p q d"]:
    """The principal components of all whole neighbourhoods."""
    import cv2

    margin = _WINDOW // 2
    exact = _rounded(features)
    windows = np.lib.stride_tricks.sliding_window_view(exact, (_WINDOW, _WINDOW), axis=(0, 1))
    down, across, channels = windows.shape[:3]
    step = max(1, int(np.sqrt(down * across / _SAMPLE)))
    basis = _rounded(principal_components(windows[::step, ::step].reshape(-1, channels * _WINDOW * _WINDOW)))
    planes = [np.ascontiguousarray(exact[..., channel]) for channel in range(channels)]
    vectors = np.empty((down, across, basis.shape[1]), np.float32)
    for component, weights in enumerate(basis.T.reshape(-1, channels, _WINDOW, _WINDOW)):
        summed = sum(cv2.filter2D(plane, cv2.CV_64F, one) for plane, one in zip(planes, weights, strict=True))
        vectors[..., component] = np.asarray(summed)[margin : margin + down, margin : margin + across]
    return vectors


def principal_components(sample: Float64[np.ndarray, "n v"]) -> Float64[np.ndarray, "v d"]:
    """Up to 8 principal components of the rows of ``sample``, in columns."""
    total = sample.sum(axis=0)
    spread = square_sums(sample) - np.outer(total, total) / len(sample)
    return np.asarray(eigenvectors(spread)[1][:, ::-1][:, :_DIMENSIONS])


def _rounded(values: np.ndarray) -> Float64[np.ndarray, "..."]:
    """Multiples of 1/4096, so that sums of products are exact in any order, thus for any number of threads."""
    return np.rint(values.astype(np.float64) * 4096) / 4096
