"""How frame stacks are compared."""

from __future__ import annotations

import numpy as np

from tests.aged import aged, stacked
from tests.synthetic import picture
from texloom.stages.common.features.control import fit_scale
from texloom.stages.common.features.principal_planes import COLOR_PLANES
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features, outlines
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.frame_stacks import frame_count, frames_of

FRAMES, CONTROL = aged(33, 64)


def test_a_stack_is_its_frames_again() -> None:
    image = stacked(FRAMES)
    assert frame_count(image.channels) == 33
    assert frame_count(picture(FRAMES[0]).channels) == 1
    for frame, again in zip(FRAMES, frames_of(image), strict=True):
        assert again.channels == ("R", "G", "B")
        np.testing.assert_array_equal(again.pixels, frame)


def test_all_frames_are_compared_in_cielab_and_alike() -> None:
    scale = fit_scale(stacked(FRAMES), None, 1.0)
    planes = scale.of_texture(stacked(FRAMES)).reshape(-1, scale.planes)
    assert scale.planes <= COLOR_PLANES
    lab = np.stack([lab_from_linear(frame).reshape(-1, 3) for frame in FRAMES])
    one, other = np.random.default_rng(0).integers(0, planes.shape[0], (2, 500))
    expected = np.square(lab[:, one] - lab[:, other]).sum(axis=2).mean(axis=0)
    found = np.square(planes[one] - planes[other]).sum(axis=1)
    assert np.abs(found - expected).mean() < 0.02 * expected.mean()
    assert (found < 1.001 * expected).all(), "a projection lengthens nothing"


def test_the_order_of_frames_does_not_matter() -> None:
    params = ControlFeaturesParams(detail=0)
    planes, backwards = (control_features(stacked(list(f)), params).planes for f in (FRAMES, FRAMES[::-1]))
    np.testing.assert_allclose(np.abs(planes), np.abs(backwards), atol=0.05)


def test_control_may_have_a_map_for_each_frame_and_limits_are_told_before() -> None:
    controls = stacked([CONTROL**power for power in np.linspace(0.5, 2, 33, dtype=np.float32)])
    texture, params = stacked(FRAMES), ControlFeaturesParams()
    one, many = (control_features(texture, params, control).planes for control in (picture(CONTROL), controls))
    assert many.shape[2] == one.shape[2] + 3
    told = outlines(params, {"texture": texture, "control": controls})["planes"]
    assert many.shape[2] <= len(told.channels) <= COLOR_PLANES + 5
