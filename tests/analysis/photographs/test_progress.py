"""Steps of large photographs say how far they are."""

from collections.abc import Callable

import numpy as np
import pytest

from texloom.stages.analysis.exemplars.tone import ToneParams, tone
from texloom.stages.analysis.light.delight import DelightParams, delight
from texloom.stages.analysis.photographs.foreign_parts import ForeignPartsParams, foreign_parts
from texloom.stages.analysis.photographs.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.analysis.photographs.lens_distortion import LensDistortionParams, lens_distortion
from texloom.stages.analysis.photographs.patch_atlas import PatchAtlasParams, patch_atlas
from texloom.stages.analysis.photographs.plane_proposal import PlaneProposalParams, plane_proposal
from texloom.stages.analysis.structure.signed_distance import signed_distance
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.progress import Progress, listening


def _front(image: Image) -> None:
    field = jacobian_field(image, JacobianFieldParams())
    places = (field.region, field.controls, field.spaces, field.sizes, field.scale)
    patch_atlas(image, *places, PatchAtlasParams(), level=field.level)


STEPS: dict[str, Callable[[Image], object]] = {
    "lens": lambda image: lens_distortion(image, LensDistortionParams()),
    "plane": lambda image: plane_proposal(image, PlaneProposalParams()),
    "surface and front": _front,
    "usable": lambda image: foreign_parts(image, ForeignPartsParams()),
    "light": lambda image: delight(image, DelightParams()),
    "tone": lambda image: tone(image, ToneParams()),
    "distance": lambda image: signed_distance(image.color[..., 0] > 0.3),
}


@pytest.mark.parametrize("step", STEPS)
def test_steps_of_photographs_report_progress(step: str):
    random = np.random.default_rng(5)
    rows, columns = np.indices((160, 200))
    joints = (rows % 20 < 3) | ((columns + 20 * (rows // 20 % 2)) % 40 < 3)
    light = np.where(joints, 0.6, 0.25)[..., None] * random.uniform(0.8, 1, (160, 200, 3))
    heard: list[Progress] = []
    with listening(heard.append):
        STEPS[step](Image(light.astype(np.float32), ("R", "G", "B")))
    shares = [progress.done for progress in heard]
    assert len(shares) >= 2
    assert all(0 <= share <= 1 for share in shares)
    if step != "surface and front":  # two steps
        assert shares == sorted(shares)
