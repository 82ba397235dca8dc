"""Times of interactive sessions: what a change of geometry takes until each picture is there.

    python -m benchmarks.sessions --side 1000

prints the fastest of several calls of each kind, each after one point has moved, on all threads that
TEXLOOM_THREADS allows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

from benchmarks.photographs import photograph
from benchmarks.timing import fastest
from texloom.stages.interactive.lattice_session import LatticeSession
from texloom.stages.interactive.photo_session import PhotoSession
from texloom.stages.kernels.core.threads import thread_count

_REPEATS = 5


def line(name: str, target: float, work: Callable[[], object]) -> None:
    """Print the time of some work beside its target."""
    work()  # compiles
    seconds = fastest(work, _REPEATS)[0]
    print(f"{name:44} {1000 * seconds.wall:7.1f} ms wall time {1000 * seconds.cpu:7.1f} ms CPU time, "
          f"target {1000 * target:.0f} ms", flush=True)  # fmt: skip


def photo_session(side: int) -> None:
    """Print the times of a `PhotoSession` with two patches."""
    session = PhotoSession(photograph(side))
    left = [
        [0.05 * side, 0.03 * side],
        [0.1 * side, 0.5 * side],
        [0.9 * side, 0.55 * side],
        [0.95 * side, 0.1 * side],
    ]
    right = [[row, side - column] for row, column in (left[1], left[0], left[3], left[2])]
    for name, corners in (("left", left), ("right", right)):
        session.place(name, corners, size=(1, 1))
    at, _ = session.controls("left")
    session.move_control("left", (1, 1), tuple(at[1, 1]))
    session.distortion()
    turn = 0

    def after_a_move(work: Callable[[], object]) -> None:
        nonlocal turn
        turn += 1
        session.move_control("left", (1, 1), tuple(at[1, 1] + turn % 7))
        work()

    for name, target, work in (
        ("Jacobians in the reduced photograph", 0.03, session.coarse),
        ("preview of a patch from the front", 0.06, partial(session.preview, "left")),
        ("Jacobians of the photograph", 0.5, session.distortion),
        ("texture of 128 x 128 px", 1.0, session.texture),
    ):
        line(name, target, partial(after_a_move, work))


def lattice_session(side: int) -> None:
    """Print the time of the preview of a `LatticeSession` with 12 x 12 cells."""
    session = LatticeSession(photograph(side))
    cell = side / 12
    session.span((cell / 2, cell / 2), (cell, 0), (0, cell))
    turn = 0

    def moved() -> None:
        nonlocal turn
        turn += 1
        session.move((5, 5), (5.5 * cell + turn % 7, 5.6 * cell))
        session.preview()

    line("straightened preview of a lattice", 0.1, moved)


def main() -> None:
    """Read the options and print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=1000, help="px of the photograph")
    options = parser.parse_args()
    print(f"{thread_count()} threads, photograph of {options.side}x{options.side} px")
    photo_session(options.side)
    lattice_session(options.side)


if __name__ == "__main__":
    main()
