"""How well a lattice of displacements explains a density of offsets."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def lattice_sums(density, mass, penalty, first, second, sums):
    """Fill ``sums`` with scores of the lattice points within the density's box, without the origin.

    Parameters
    ----------
    density : (h, w) float32, offset (0, 0) in the middle; 0 where no offset is near
    mass : (h, w) float32, sum of the density around each place
    penalty : float, subtracted for each lattice point without offsets
    first, second : (n, 2) float64, the generators of n lattices, px, row before column
    sums : (n, 3) float64, output: score, number of lattice points, mass
    """
    height, width = density.shape
    reach_row, reach_column = height // 2, width // 2
    for index in range(first.shape[0]):
        ar, ac = first[index]
        br, bc = second[index]
        determinant = ar * bc - ac * br
        sums[index] = 0
        if abs(determinant) < 1:
            continue
        # |k| of any lattice point in the box, from the box's corners in lattice coordinates
        most_a = np.int64((reach_row * abs(bc) + reach_column * abs(br)) / abs(determinant))
        for a in range(most_a + 1):  # the lattice is symmetric, so one half is enough
            # the run of b for which a * first + b * second lies in the box
            low, high = -np.inf, np.inf
            for axis in range(2):
                start = a * (ar if axis == 0 else ac)
                step = br if axis == 0 else bc
                reach = reach_row if axis == 0 else reach_column
                if step == 0:
                    if abs(start) > reach:
                        low, high = 1.0, 0.0
                else:
                    one, other = (-reach - start) / step, (reach - start) / step
                    low, high = max(low, min(one, other)), min(high, max(one, other))
            for b in range(np.int64(np.ceil(low)), np.int64(np.floor(high)) + 1):
                if a == 0 and b <= 0:
                    continue
                row = np.int64(np.rint(a * ar + b * br)) + reach_row
                column = np.int64(np.rint(a * ac + b * bc)) + reach_column
                if row < 0 or column < 0 or row >= height or column >= width:
                    continue
                value = density[row, column]
                sums[index, 0] += value if value > 0 else -penalty
                sums[index, 1] += 1
                sums[index, 2] += mass[row, column]
