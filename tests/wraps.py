"""Borders across which a picture may continue."""

from collections.abc import Sequence

from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

X, Y = Wraps(across=True), Wraps(down=True)
WRAPS = [NOWHERE, TORUS, X, Y]


def sides(shape: Sequence[int], extra: int, wrap: Wraps) -> tuple[int, int]:
    """The first two of ``shape`` with ``extra`` more along axes that do not wrap."""
    down, across = (side + (0 if around else extra) for side, around in zip(shape[:2], wrap, strict=True))
    return down, across


def beyond(extra: int, wrap: Wraps) -> list[tuple[int, int]]:
    """The width for `numpy.pad` of planes that go on by ``extra`` where they wrap."""
    return [(0, extra if around else 0) for around in wrap]
