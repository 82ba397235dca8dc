"""What is annotated is checked in calls of stages and their helpers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float32

from tests.annotations import checked
from texloom.stages.common.grids.pyramid import resize

Plane = Float32[np.ndarray, "h w"]
PLANE, OTHER = np.zeros((3, 4), np.float32), np.zeros((3, 5), np.float32)


@checked
@dataclass
class Pair:
    first: Plane
    second: Plane | None

    @property
    @checked
    def size(self) -> int:
        return str(self.first.size)  # type: ignore[return-value]

    @staticmethod
    @checked
    def beside(first: Plane, *more: Plane) -> Plane:
        return first


@checked
def chosen(plane: Plane, other: Plane, count: int = 1) -> Plane:
    return (plane, other, plane[:2])[count]


@checked
def doubled(count: int) -> int:
    return 2 * count if count else None  # type: ignore[return-value]


@checked
def known_to_type_checkers(plane: Plane, other: Plane, name: "Unknown") -> Plane:  # type: ignore[name-defined]
    return plane


def beside(known: Plane) -> Callable[..., Any]:
    @checked
    def shape(other: Plane, times: int = 1) -> tuple[int, int]:
        return known.shape if times else other.size

    return shape


@checked
def counted(last: int) -> Iterator[int]:
    yield from range(last)


def test_what_matches_passes() -> None:
    assert chosen(PLANE, PLANE) is PLANE
    assert chosen(OTHER, other=OTHER, count=0) is OTHER
    assert Pair(PLANE, None).second is None
    assert Pair.beside(PLANE, PLANE, PLANE) is PLANE
    assert doubled(3) == 6
    assert known_to_type_checkers(PLANE, PLANE, "anything") is PLANE
    assert list(counted(3)) == [0, 1, 2]


@pytest.mark.parametrize(
    "call",
    [
        lambda: chosen(PLANE, OTHER),  # one name of an axis, two sizes
        lambda: chosen(PLANE, PLANE.astype(np.float64)),
        lambda: chosen(PLANE, PLANE, 2),  # the result's height
        lambda: Pair(PLANE, OTHER),
        lambda: Pair(PLANE, None).size,
        lambda: Pair.beside(PLANE, PLANE, OTHER),
        lambda: doubled("3"),  # type: ignore[arg-type]
        lambda: doubled(0),
        lambda: known_to_type_checkers(PLANE, OTHER, "anything"),
    ],
)
def test_what_does_not_is_refused(call: Any) -> None:
    with pytest.raises(BeartypeCallHintViolation):
        call()


def test_functions_inside_others_are_checked_each_by_itself() -> None:
    first, second = beside(PLANE), beside(OTHER)
    for _ in range(2):
        assert (first(OTHER), second(PLANE)) == (PLANE.shape, OTHER.shape)
    for one in (first, second, beside(PLANE)):
        for wrong in ((PLANE[0],), (PLANE, "1"), (PLANE, 0)):
            with pytest.raises(BeartypeCallHintViolation):
                one(*wrong)


def test_functions_of_stages_are_checked() -> None:
    with pytest.raises(BeartypeCallHintViolation):
        resize("no plane", 3, 3)  # type: ignore[arg-type]


def test_generators_are_checked_too() -> None:
    with pytest.raises(TypeError):
        counted("3")
