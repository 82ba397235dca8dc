"""How much a lattice changes that is fitted to the sides of a result, and how visible that is."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.numerics.matrices import inverse_of, matrix_product

_WEIGHTS = np.array([[1.0, 9.0], [9.0, 1.0]])  # shear is more visible than a change of spacing


def lattice_strain(
    generators: Float64[np.ndarray, "2 2"], own: Float64[np.ndarray, "2 2"]
) -> Float64[np.ndarray, "2 2"]:
    """By how much rows and columns move, px a px down and across, where ``own`` generators replace others.

    Examples
    --------
    >>> generators = np.array([[10.0, 0.0], [0.0, 20.0]])
    >>> lattice_strain(generators, np.array([[11.0, 0.0], [1.0, 20.0]]))
    array([[0.1 , 0.  ],
           [0.05, 0.  ]])
    """
    return np.asarray(matrix_product(inverse_of(generators), own) - np.eye(2))


def visibility(strain: Float64[np.ndarray, "2 2"]) -> float:
    """How visible a strain is: the sum of its squares, of those that turn rows or columns nine times."""
    return float((strain**2 * _WEIGHTS).sum())
