"""The patches of an exemplar from which a result was voted, by which other maps can be voted again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import UInt32

from texloom.stages.vocabulary.facts import Wraps


@dataclasses.dataclass(frozen=True)
class VotedPatches:
    """What `optimise` has voted its result from."""

    patches: UInt32[np.ndarray, "p q 2"]
    """top-left pixel of the exemplar patch of each target patch, in the exemplar with its border"""
    exemplar: tuple[int, int]
    """height and width of the exemplar, px"""
    patch_size: int
    """side of a patch, px"""
    final_sigma: float | None
    """standard deviation of the Gaussian weights of the votes, px; None where all weigh alike"""
    border: bool
    """whether the exemplar is continued by its mirror image"""
    even_joints: bool
    """whether steps of tone at joints were spread"""
    wraps: Wraps
    """of the result"""

    @classmethod
    def of(cls, patches: UInt32[np.ndarray, "p q 2"], voting: Mapping[str, Any]) -> VotedPatches:
        """From the outputs of `optimise`; `ValueError` if they are none."""
        try:
            return cls(
                patches,
                (int(voting["exemplar"][0]), int(voting["exemplar"][1])),
                int(voting["patch_size"]),
                None if voting["final_sigma"] is None else float(voting["final_sigma"]),
                bool(voting["border"]),
                bool(voting.get("even_joints", False)),
                Wraps.of(voting["wraps"]),
            )
        except (KeyError, TypeError, IndexError):
            raise ValueError("does not say how a result was voted") from None

    def record(self) -> dict[str, Any]:
        """All but the patches, ready for JSON."""
        known = {name: getattr(self, name) for name in ("patch_size", "final_sigma", "border", "even_joints")}
        return {"exemplar": list(self.exemplar), **known, "wraps": str(self.wraps)}

    @property
    def margin(self) -> tuple[int, int]:
        """What was voted above and below the result, left and right of it, px."""
        return self.wraps.where_open(self.patch_size - 1)
