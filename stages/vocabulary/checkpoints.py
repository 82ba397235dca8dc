"""Checkpoints of long stages, from which an interrupted run continues."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar, runtime_checkable

T = TypeVar("T")


@runtime_checkable
class Checkpoints(Protocol):
    """Storage of a stage's state between scales. A state is a frozen dataclass of arrays and scalars."""

    def latest(self, state: type[T]) -> tuple[int, T] | None:
        """The highest valid checkpoint of an earlier run of the same step, and its level."""

    def save(self, level: int, state: Any) -> None:
        """Store ``state`` as the result of ``level`` (from 1)."""


class NoCheckpoints:
    """Stores nothing; for direct calls of a stage."""

    def latest(self, state: type[T]) -> tuple[int, T] | None:  # noqa: ARG002
        """None: nothing is stored."""
        return None

    def save(self, level: int, state: Any) -> None:
        """Do nothing."""
