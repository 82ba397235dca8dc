"""How a long stage keeps work that is half done: an interrupted run goes on from the last checkpoint."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar, runtime_checkable

T = TypeVar("T")


@runtime_checkable
class Checkpoints(Protocol):
    """Where a stage leaves its state between scales. A state is a frozen dataclass of arrays and scalars."""

    def latest(self, state: type[T]) -> tuple[int, T] | None:
        """The highest whole checkpoint that an earlier run of this very step left, and its level."""

    def save(self, level: int, state: Any) -> None:
        """Keep ``state`` as the result of ``level`` (from 1)."""


class NoCheckpoints:
    """Keeps nothing: for calling a stage as a plain function."""

    def latest(self, state: type[T]) -> tuple[int, T] | None:  # noqa: ARG002
        """Nothing was kept."""
        return None

    def save(self, level: int, state: Any) -> None:
        """Forget it."""
