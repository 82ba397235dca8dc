"""What patch optimisation requires of its inputs."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool

from texloom.stages.common.features.maps import check_weights
from texloom.stages.common.grids.size_checks import check_patch
from texloom.stages.synthesis.optimisation.coarse_to_fine import CoarseToFineParams
from texloom.stages.vocabulary.arrays import Correspondence, Image, ScalarMap
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.masks import without_usable
from texloom.stages.vocabulary.sizes import format_size


def check_patches(params: CoarseToFineParams, known: Mapping[str, Any]) -> None:
    """The exemplar must contain more than one patch, and have the maps of ``weights``; a tileable result, one."""
    image, start = known.get("image"), known.get("start")
    if image is not None:
        check_weights(params.weights, image.channels)
        check_patch(image, params.patch_size)
    if start is not None and params.tileable:
        sides = zip(start.shape[:2], params.tileable, strict=True)
        if any(around and side < params.patch_size for side, around in sides):
            raise InputError(
                f"start: a tileable result of {format_size(start.shape)} does not hold a patch "
                f"of {params.patch_size} px"
            )


def check_start(image: Image, start: Correspondence) -> None:
    """`ValueError` where the start has sources beyond the exemplar."""
    if (start.max(axis=(0, 1)) >= (image.height, image.width)).any():
        raise ValueError(f"start points beyond the exemplar of {format_size(image)}")


def check_inputs(
    image: Image,
    start: Correspondence,
    keep: Bool[np.ndarray, "_ _"] | None,
    given: Image | None,
    guiding: Bool[np.ndarray, "_ _"] | None,
    planes: Mapping[str, ScalarMap | None],
) -> None:
    """`ValueError` where what is given does not fit the exemplar or the start; ``planes`` are of the exemplar."""
    height, width = start.shape[:2]
    for name, plane in planes.items():
        if plane is not None and plane.shape != (image.height, image.width):
            raise ValueError(f"{name} of shape {plane.shape} for an exemplar of {format_size(image)}")
    check_start(image, start)
    if keep is not None and keep.shape != (height, width):
        raise ValueError(f"keep of shape {keep.shape} for a start of {format_size((height, width))}")
    if guiding is not None and guiding.shape != (height, width):
        raise ValueError(f"guiding of shape {guiding.shape} for a start of {format_size((height, width))}")
    if given is not None:
        if (given.height, given.width) != (height, width):
            raise ValueError(f"given of {format_size(given)} for a start of {format_size((height, width))}")
        channels = without_usable(image).channels
        if given.channels != channels:
            raise ValueError(f"given has the channels {given.channels}, the exemplar {channels}")
