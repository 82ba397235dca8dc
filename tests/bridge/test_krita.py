"""What of the plug-in for Krita needs no Krita: its archive, and its pixels."""

from __future__ import annotations

import configparser
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.bridge.conftest import builder
from tests.conftest import ROOT

PROGRAM = "krita"
SRGB, LINEAR = "sRGB-elle-V2-srgbtrc.icc", "sRGB-elle-V2-g10.icc"
DTYPES = {"U8": np.uint8, "U16": np.uint16, "F16": np.float16, "F32": np.float32}


def test_the_archive_is_as_krita_imports_it(archive: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(archive) as opened:
        names = opened.namelist()
        about = configparser.ConfigParser()
        about.read_string(opened.read("texloom.desktop").decode())
        actions = ElementTree.fromstring(opened.read("texloom.action"))
        assert opened.read("texloom/texloom_client.py") == (ROOT / "pipelines/bridge/client.py").read_bytes()
    module = about["Desktop Entry"]["X-KDE-Library"]
    assert {f"{module}/", f"{module}/__init__.py", f"{module}/{about['Desktop Entry']['X-Krita-Manual']}"} <= set(
        names
    )
    assert {"texloom/LICENSE", "texloom/controller.py", "texloom/requests.py"} <= set(names)
    assert not any(name.startswith("/") or ".." in name for name in names)
    named = [one.get("name") for one in actions.iter("Action")]
    assert named == [f"texloom_{one}" for one in ("make_tileable", "larger", "fill", "revise", "settings")]
    assert builder().build(PROGRAM, tmp_path).read_bytes() == archive.read_bytes()


def stored(form: Any, rgba: np.ndarray) -> bytes:
    """As Krita has it: integers from blue on."""
    if form.model == "GRAYA":
        return np.ascontiguousarray(rgba[..., [0, 3]]).tobytes()
    return np.ascontiguousarray(rgba[..., [2, 1, 0, 3]] if form.depth.startswith("U") else rgba).tobytes()


def values(depth: str, *shape: int) -> np.ndarray:
    chance = np.random.default_rng(1)
    if depth.startswith("U"):
        return chance.integers(0, np.iinfo(DTYPES[depth]).max + 1, shape, DTYPES[depth])
    return (2 * chance.random(shape)).astype(DTYPES[depth])


@pytest.mark.parametrize("model", ["RGBA", "GRAYA"])
@pytest.mark.parametrize(
    ("depth", "profile", "sent"),
    [
        ("U8", SRGB, "uint8"), ("U16", SRGB, "uint16"), ("U8", LINEAR, "float32"), ("U16", LINEAR, "float32"),
        ("F16", LINEAR, "float32"), ("F32", LINEAR, "float32"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("is_opaque", [True, False])
def test_pixels_there_and_back(
    plugin: Any, model: str, depth: str, profile: str, sent: str, is_opaque: bool
) -> None:
    channels = plugin("channels")
    form = channels.Format(model, depth, profile)
    rgba = values(depth, 5, 7, 4)
    rgba[..., 3] = np.iinfo(DTYPES[depth]).max if depth.startswith("U") else 1
    if not is_opaque:
        rgba[1, 2, 3] = 0
    data = stored(form, rgba)
    made = channels.to_pixels(data, 7, 5, form)
    assert (made.dtype, made.shape) == (
        sent, (5, 7, 4) if not is_opaque else (5, 7) if model == "GRAYA" else (5, 7, 3)
    )  # fmt: skip
    full = np.iinfo(DTYPES[depth]).max if depth.startswith("U") and sent == "float32" else 1
    wanted = rgba[..., :1].repeat(3, 2) if model == "GRAYA" else rgba[..., :3]
    shown = made.numpy()[..., :3] if made.numpy().ndim == 3 else made.numpy()[..., None].repeat(3, 2)
    np.testing.assert_array_equal(shown, (wanted / np.float64(full)).astype(sent))
    assert channels.to_bytes(made, form) == data


def test_what_is_selected_becomes_alpha(plugin: Any) -> None:
    channels = plugin("channels")
    for depth, profile in (("U8", SRGB), ("U16", SRGB), ("F32", LINEAR)):
        form = channels.Format("RGBA", depth, profile)
        full = np.iinfo(DTYPES[depth]).max if depth.startswith("U") else 1
        rgba = values(depth, 1, 3, 4)
        rgba[..., 3] = full
        levels = bytes([0, 51, 255])
        made = channels.to_pixels(stored(form, rgba), 3, 1, form)
        shown = np.frombuffer(channels.to_bytes(made, form, levels), DTYPES[depth]).reshape(3, 4)
        np.testing.assert_allclose(shown[:, 3], np.array([0, 0.2, 1]) * full, rtol=1e-6)
        rgba[0, 1, 3] = 0  # what is transparent remains so
        made = channels.to_pixels(stored(form, rgba), 3, 1, form)
        shown = np.frombuffer(channels.to_bytes(made, form, levels), DTYPES[depth]).reshape(3, 4)
        np.testing.assert_allclose(shown[:, 3], np.array([0, 0, 1]) * full, rtol=1e-6)


@pytest.mark.parametrize(
    ("form", "problem"),
    [
        (("CMYKA", "U8", "Chemical proof"), "the layer is CMYKA of U8; convert it"),
        (("RGBA", "U32", SRGB), "the layer is RGBA of U32"),
        (("RGBA", "F32", SRGB), "floats in the profile sRGB-elle-V2-srgbtrc.icc; convert it to a linear one"),
    ],
)
def test_layers_that_are_refused(plugin: Any, form: tuple[str, str, str], problem: str) -> None:
    channels = plugin("channels")
    with pytest.raises(plugin("texloom_client").TexloomError, match=problem):
        channels.to_pixels(b"", 1, 1, channels.Format(*form))


def test_other_profiles_are_told(plugin: Any) -> None:
    form = plugin("channels").Format
    assert form("RGBA", "U8", SRGB).note == form("RGBA", "U16", LINEAR).note == ""
    assert form("RGBA", "U8", "Adobe RGB").note == (
        "the profile Adobe RGB is taken for sRGB while textures are compared; it stays"
    )


def test_only_methods_with_presets_get_one(plugin: Any) -> None:
    """Others would refuse it, and have one speed."""
    requests = plugin("requests")
    asked = [
        requests.larger(None, 8, 8, "off", method, "fast", 3)[0].options for method in ("quilting", "self_tuning")
    ]
    assert [one.get("preset") for one in asked] == [None, "fast"]
