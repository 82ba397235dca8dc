"""The planes by which frame stacks are compared."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.similarity.components import components
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.frame_stacks import frames_of

COLOR_PLANES = 12
"""principal planes of the colour of a stack, at most"""
CONTROL_PLANES = 4
"""principal planes of a stack of more control maps than this"""
KEPT = 0.995
"""share of the variance of colour that the principal planes keep, where their number allows"""
_SAMPLE = 20000  # pixels by which principal planes are fitted


def lab_of_frames(image: Image) -> Float32[np.ndarray, "h w c"]:
    """CIELAB of all frames, such that squared distances are means over the frames."""
    frames = frames_of(image)
    planes = np.concatenate([lab_from_linear(frame.color) for frame in frames], axis=2)
    return planes / np.float32(np.sqrt(len(frames)))


@dataclass(frozen=True)
class PrincipalPlanes:
    """The projection of many planes on their principal components, which keeps distances."""

    mean: Float32[np.ndarray, " c"]
    basis: Float32[np.ndarray, "c k"]

    @classmethod
    def of(cls, planes: Float32[np.ndarray, "h w c"], most: int, kept: float = 1.0) -> "PrincipalPlanes":
        """At most ``most`` components, and no more than keep a share ``kept`` of the variance."""
        rows = planes.reshape(-1, planes.shape[2])
        sample = rows[:: max(1, len(rows) // _SAMPLE)]
        mean, basis = components(sample, min(most, planes.shape[2]))
        variances = np.square(row_product(sample - mean, basis)).mean(axis=0)
        needed = kept * float(sample.var(axis=0, dtype=np.float64).sum())
        count = 1 + int((np.cumsum(variances)[:-1] < needed).sum())
        return cls(mean.astype(np.float32), np.ascontiguousarray(basis[:, :count], np.float32))

    @property
    def count(self) -> int:
        """The number of planes after the projection."""
        return int(self.basis.shape[1])

    def project(self, planes: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w k"]:
        """The principal planes."""
        rows = row_product(planes.reshape(-1, planes.shape[2]) - self.mean, self.basis)
        return rows.reshape(*planes.shape[:2], self.count)
