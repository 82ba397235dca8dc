"""Features beside OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import skimage.data

from texloom.stages.common.features.sift import features


@pytest.mark.parametrize("name", ["brick", "gravel"])
def test_the_same_features_as_with_opencv(name: str) -> None:
    picture = getattr(skimage.data, name)()[100:260, 60:220]
    keypoints, expected = cv2.SIFT.create().detectAndCompute(picture, None)
    theirs = np.array([keypoint.pt[::-1] for keypoint in keypoints])
    places, strengths, descriptors = features(picture)
    assert abs(len(places) - len(theirs)) <= 0.01 * len(theirs)
    near = np.abs(theirs[:, None] - places).max(axis=2) < 0.05
    assert near.any(axis=1).mean() >= 0.98
    both = [(one, descriptors[own]) for one, own in zip(expected, near, strict=True) if own.any()]
    differences = np.array([np.abs(found - one).max(axis=1).min() for one, found in both])
    assert (differences <= 2).mean() >= 0.95
    assert strengths.max() == pytest.approx(max(keypoint.response for keypoint in keypoints), rel=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (5, 40), (40, 40)])
def test_flat_and_tiny_pictures_have_none(shape: tuple[int, int]) -> None:
    places, strengths, descriptors = features(np.full(shape, 90, np.uint8))
    assert places.shape == (0, 2)
    assert strengths.shape == (0,)
    assert descriptors.shape == (0, 128)
