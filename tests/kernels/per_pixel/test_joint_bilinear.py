import numpy as np
import pytest

from texloom.stages.kernels.per_pixel.joint_bilinear import enlarge


def naive(coarse: np.ndarray, own: np.ndarray, wrap: tuple[bool, bool], control: np.ndarray) -> np.ndarray:
    """Means of the four nearest coarse pixels, by distance and by how alike their control is."""
    sides, shape = coarse.shape[:2], control.shape[:2]
    sums, total = np.zeros((*shape, coarse.shape[2])), np.zeros((*shape, 1))
    places = [(np.arange(many) + 0.5) * few / many - 0.5 for many, few in zip(shape, sides, strict=True)]
    for steps in np.ndindex(2, 2):
        index = [np.floor(place).astype(int) + step for place, step in zip(places, steps, strict=True)]
        down, across = (1 - np.abs(place - at) for place, at in zip(places, index, strict=True))
        near = np.ix_(
            *(
                at % side if around else np.clip(at, 0, side - 1)
                for at, side, around in zip(index, sides, wrap, strict=True)
            )
        )
        unlike = np.square(control.astype(np.float64) - own[near]).sum(axis=2)
        weight = ((down[:, None] * across + 0.01) / np.square(1 + 100 * unlike))[..., None]
        sums += weight * coarse[near]
        total += weight
    return np.asarray(sums / total)


@pytest.mark.parametrize("wrap", [(False, False), (True, False), (True, True)])
def test_each_pixel_is_a_mean_of_the_nearest_of_its_control(
    wrap: tuple[bool, bool], rng: np.random.Generator
) -> None:
    coarse, own = rng.random((4, 5, 3), np.float32), rng.random((4, 5, 2), np.float32)
    planes = np.full((19, 23, 5), 7, np.float32)
    planes[..., :2] = rng.random((19, 23, 2), np.float32)
    enlarge(coarse, own, wrap, planes, 2, 3, 23, 0, 17)
    np.testing.assert_allclose(planes[:17, 3:, 2:], naive(coarse, own, wrap, planes[..., :2])[:17, 3:], atol=1e-6)
    assert (planes[17:, :, 2:] == 7).all()
    assert (planes[:, :3, 2:] == 7).all()
