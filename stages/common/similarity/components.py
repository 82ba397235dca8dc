"""Principal components of a sample."""

import numpy as np

from texloom.stages.numerics.matrices import eigenvectors, square_sums


def components(sample: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the rows and their principal components, (values, count), padded with zeros."""
    centred = sample.astype(np.float64)
    mean = centred.mean(axis=0)
    centred -= mean
    _, vectors = eigenvectors(square_sums(centred) * (1 / len(sample)))
    basis = np.zeros((sample.shape[1], count))
    kept = min(count, sample.shape[1])
    basis[:, :kept] = vectors[:, ::-1][:, :kept]
    basis *= np.where(basis[np.abs(basis).argmax(axis=0), np.arange(count)] < 0, -1, 1)
    return mean, basis
