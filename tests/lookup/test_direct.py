"""Stages called directly, with arrays and keyword arguments."""

from __future__ import annotations

import inspect
import pkgutil
from typing import Any

import numpy as np
import pytest

import texloom
from texloom.stages.analysis.exemplars.crop import CropParams
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.synthesis.stitching.quilting import QuiltingParams, quilting
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHORT = [name.rpartition(".")[2] for name in stage_names()]


@pytest.fixture
def rgb(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, (40, 48, 3), np.uint8)


def test_short_names_are_unique_and_no_modules() -> None:
    import texloom.stages

    modules = [entry.name for entry in pkgutil.iter_modules(texloom.stages.__path__)]
    assert len({*SHORT, *modules}) == len(SHORT) + len(modules)


@pytest.mark.parametrize("name", stage_names())
def test_every_stage_is_there_with_its_inputs_and_params(name: str) -> None:
    call = getattr(texloom.stages, name.rpartition(".")[2])
    stage = find_stage(name)
    parameters = inspect.signature(call).parameters
    assert {*stage.inputs, *stage.params.model_fields} <= set(parameters)
    assert not {*stage.inputs} & {*stage.params.model_fields}, "one could not be given by name"
    assert call.__doc__ == stage.function.__doc__
    assert name.rpartition(".")[2] in dir(texloom.stages)


def test_it_is_the_stage(rgb: np.ndarray) -> None:
    made = texloom.stages.quilting(rgb, size=(64, 72), seed=3)
    params = QuiltingParams(size=(64, 72))
    assert np.array_equal(made.image, quilting(Image.of(rgb), params, np.random.default_rng(3)).image)
    assert np.array_equal(made.image, texloom.stages.quilting(image=rgb, params=params, seed=3).image)
    assert np.array_equal(
        made.image, texloom.stages.quilting(rgb, params=params, rng=np.random.default_rng(3)).image
    )
    assert not np.array_equal(made.image, texloom.stages.quilting(rgb, size=(64, 72), seed=4).image)


def test_arrays_become_what_the_stage_takes(rgb: np.ndarray) -> None:
    edges = texloom.stages.edges(rgb)
    structure = texloom.stages.otsu(edges.strength.astype(np.float64), image=rgb).structure
    assert structure.dtype == bool
    sheet = texloom.stages.contact_sheet([rgb, None, rgb], items=[{"name": n} for n in "abc"])
    assert isinstance(sheet.image, Image)
    with pytest.raises(InputError, match="signed_distance: structure: an array of float32 given, of bool"):
        texloom.stages.signed_distance(edges.strength)


def test_integers_are_srgb_and_floats_are_linear(rgb: np.ndarray) -> None:
    linear = Image.of(rgb).pixels
    assert np.array_equal(
        texloom.stages.crop(linear, size=(8, 8)).image, texloom.stages.crop(rgb, size=(8, 8)).image
    )
    deep = (rgb.astype(np.uint16) * 257)[..., 0]
    grey = Image.of(deep)
    assert grey.channels == ("Y",)
    assert np.array_equal(grey.pixels[..., 0], linear[..., 0])
    assert np.array_equal(Image.of(rgb).srgb, rgb)
    assert Image.of(np.dstack([rgb, rgb[..., 0]])).pixels[..., 3] == pytest.approx(rgb[..., 0] / 255)


RGB = np.zeros((40, 48, 3), np.uint8)


@pytest.mark.parametrize(
    ("inputs", "named", "error", "said"),
    [
        ((RGB,), {"sise": 8}, InputError, "quilting: no input or param 'sise'; did you mean 'size'"),
        ((RGB,), {"size": (3, 64)}, InputError, r"quilting: size: the height .* got 3"),
        ((), {}, InputError, "quilting: needs 'image'"),
        (("brick.png",), {}, InputError, "quilting: image: a str given"),
        ((RGB.astype(np.int64),), {}, InputError, "image: an array of int64 is no image"),
        ((RGB[..., :2],), {}, InputError, r"image: an array of shape \(40, 48, 2\)"),
        ((np.full((40, 40), np.nan),), {}, InputError, "NaN"),
        ((RGB,), {"params": CropParams()}, InputError, r"params: .* QuiltingParams expected"),
        ((RGB,), {"image": RGB}, TypeError, "multiple values for 'image'"),
        ((RGB, RGB), {}, TypeError, "at most 1 inputs"),
    ],
)
def test_wrong_calls_are_refused(inputs: Any, named: dict[str, Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        texloom.stages.quilting(*inputs, **named)


def test_unknown_stages_are_refused() -> None:
    with pytest.raises(AttributeError, match="no stage 'quiltin'; did you mean 'quilting'"):
        _ = texloom.stages.quiltin


def test_checks_run_on_direct_calls(rgb: np.ndarray) -> None:
    """Of the friendly function and of the stage's own; once a call."""
    with pytest.raises(InputError, match=r"^quilting: image: 4 x 4 px is too small"):
        texloom.stages.quilting(rgb[:4, :4])
    with pytest.raises(InputError, match=r"^image: 4 x 4 px is too small"):
        quilting(Image.of(rgb[:4, :4]), QuiltingParams(), np.random.default_rng(1))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int64, np.float64, bool])
def test_an_image_is_linear_light_in_float32(dtype: type) -> None:
    with pytest.raises(TypeError, match=r"not linear light in float32; Image.of"):
        Image(np.ones((4, 4, 1), dtype), ("Y",))


def test_an_image_is_an_array() -> None:
    image = Image.of(np.zeros((4, 5), np.uint8))
    assert np.asarray(image).shape == image.shape == (4, 5, 1)
    assert np.asarray(image, np.float64).dtype == np.float64
