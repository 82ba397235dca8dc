import numpy as np

from texloom.stages.kernels.per_pixel.positions import (
    PIXEL,
    advect,
    agree,
    displace,
    phase_offset,
    pixel_number,
    place_of,
    snap_to_valid,
    transfer,
)

ROWS, PITCH = 9, 13


def position(row: float, column: float) -> int:
    return round(row * PIXEL) << 32 | round(column * PIXEL)


def test_positions_stand_for_the_nearest_place() -> None:
    assert place_of(position(3.49, 6.5), PITCH) == 3 * PITCH + 7
    assert snap_to_valid(position(3.3, 4.1), 3 * PITCH + 4, PITCH) == position(3.3, 4.1)
    assert snap_to_valid(position(3.3, 4.1), 5 * PITCH + 2, PITCH) == position(5, 2)
    assert transfer(position(3.25, 3.75), 6 * PITCH + 1, PITCH) == position(6.25, 0.75)
    assert agree(position(3, 3), position(3.75, 2.25))
    assert not agree(position(3, 3), position(3, 3.78))


def test_displacements_stay_inside() -> None:
    assert displace(position(2, 3), 0.5, -1.25, PITCH, ROWS) == position(2.5, 1.75)
    assert displace(position(2, 3), -5.0, 50.0, PITCH, ROWS) == position(0, PITCH - 1)


def test_advection_uses_the_jacobian_halfway() -> None:
    jacobian = np.tile(np.array([1, 0, 0, 1], np.float32), (ROWS * PITCH, 1))
    jacobian.reshape(ROWS, PITCH, 4)[4:] *= 2
    down, none = np.float32(2), np.float32(0)
    assert advect(position(3, 5), down, none, jacobian, PITCH, ROWS) == position(7, 5)  # halfway is row 4
    assert advect(position(2, 5), down, none, jacobian, PITCH, ROWS) == position(4, 5)
    assert advect(position(2, 5), none, down, jacobian, PITCH, ROWS) == position(2, 7)


def test_pixels_of_the_endless_result_have_different_numbers() -> None:
    sides = (-(2**30), -2, -1, 0, 1, 2**30)
    assert len({pixel_number(row, column) for row in sides for column in sides}) == 36


def test_phases_differ_by_less_than_half_a_repetition() -> None:
    generators, eighth = (800, 0, 0, 1600), 2**29
    phases = (np.uint32(share * eighth) for share in (1, 7, 7, 0))
    assert phase_offset(*phases, generators) == (200, -200)
