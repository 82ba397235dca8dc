"""CIE L*a*b* of 16 bits, as TIFF has it, to linear light; nothing beyond sRGB is clipped."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media.color_spaces import D50, converted, from_d50

_KNEE = 6 / 29  # CIE 15:2004, section 8.2.1.1
_STEPS = 256  # a step of a* and b*, which are signed


@dataclasses.dataclass(frozen=True)
class Lab:
    """How codes of TIFF's photometric interpretation 8 (TIFF 6.0, section 23) become linear Rec.709 light."""

    def linear(self, codes: np.ndarray) -> Float32[np.ndarray, "h w 3"]:
        """Linear light of codes, uint16, (h, w, 3): L* of 100 is 65535, a* and b* are signed 256ths."""
        lightness = (codes[..., 0] * np.float32(100 / 65535) + 16) / 116
        red, blue = (codes[..., plane].view(np.int16).astype(np.float32) / _STEPS for plane in (1, 2))
        cubic = np.stack([lightness + red / 500, lightness, lightness - blue / 200], axis=2)
        relative = np.where(cubic > _KNEE, cubic**3, 3 * _KNEE**2 * (cubic - 4 / 29)).astype(np.float32)
        return converted(relative, from_d50(np.diag(D50)))
