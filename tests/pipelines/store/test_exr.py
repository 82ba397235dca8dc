"""Files that are written and read in pieces."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from jaxtyping import Bool, Float64

from texloom.pipelines.store import codec, exr
from texloom.stages.vocabulary.arrays import Correspondence, Image, ScalarMap

SHAPE = (600, 530)
RNG = np.random.default_rng(3)


@dataclasses.dataclass(frozen=True)
class Large:
    """Outputs of which some are written tile by tile."""

    image: Image
    match: Correspondence
    exact: Float64[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    small: ScalarMap


LARGE = Large(
    Image(RNG.random((*SHAPE, 3), np.float32), ("R", "G", "B")),
    RNG.integers(0, 2**32, (*SHAPE, 2), np.uint32),
    RNG.random(SHAPE),
    RNG.random(SHAPE) > 0.5,
    RNG.random((30, 40), np.float32),
)


@pytest.fixture(autouse=True)
def few_pixels_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr, "TILED", 2**16)


def parts_of(large: Large) -> dict[str, exr.Planes]:
    return {
        "image": {name: large.image.pixels[..., index] for index, name in enumerate("RGB")},
        "match": {"match.row": large.match[..., 0], "match.column": large.match[..., 1]},
        "small": {"small": large.small},
    }


@pytest.mark.parametrize("compression", ["ZSTD", "ZIP", "NO"])
@pytest.mark.parametrize("names", [["image", "match", "small"], ["small", "image"], ["image"]])
def test_a_file_in_bands_is_the_one_that_openexr_writes(names: list[str], compression: str, tmp_path: Path) -> None:
    parts = {name: parts_of(LARGE)[name] for name in names}
    exr.write(tmp_path / "bands.exr", parts, {"made": "by a test"}, compression)
    height, width = parts[names[0]][next(iter(parts[names[0]]))].shape
    whole = []
    for name, planes in parts.items():
        shape = next(iter(planes.values())).shape
        header = {
            "type": OpenEXR.scanlineimage if name == "small" else OpenEXR.tiledimage,
            "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
            "displayWindow": (np.zeros(2, np.int32), np.array([width - 1, height - 1], np.int32)),
            "dataWindow": (np.zeros(2, np.int32), np.array([shape[1] - 1, shape[0] - 1], np.int32)),
            **({} if whole else {"made": "by a test"}),
        }
        if name != "small":
            header["tiles"] = OpenEXR.TileDescription()
            header["tiles"].xSize = header["tiles"].ySize = 256
        copies = {channel: np.ascontiguousarray(plane) for channel, plane in planes.items()}
        whole.append(OpenEXR.Part(header, copies, name))
    with exr.set_up():
        OpenEXR.File(whole).write(str(tmp_path / "whole.exr"))
    assert (tmp_path / "bands.exr").read_bytes() == (tmp_path / "whole.exr").read_bytes()


def test_large_results_come_back_in_bands(tmp_path: Path) -> None:
    codec.write(LARGE, tmp_path, {})
    values = codec.read(Large, tmp_path)
    np.testing.assert_array_equal(values["image"].pixels, LARGE.image.pixels)
    for name in ("match", "exact", "mask", "small"):
        np.testing.assert_array_equal(values[name], getattr(LARGE, name), strict=True)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(0, 1), slice(0, 1)),
        (slice(0, 256), slice(256, 512)),
        (slice(255, 257), slice(511, 530)),
        (slice(599, 600), slice(None)),
        (slice(None), slice(None)),
    ],
)
def test_windows_hold_what_the_whole_does(rows: slice, columns: slice, tmp_path: Path) -> None:
    codec.write(LARGE, tmp_path, {})
    image = codec.window(tmp_path, "image", rows, columns)
    assert list(image) == ["R", "G", "B"]
    np.testing.assert_array_equal(np.stack(list(image.values()), axis=2), LARGE.image.pixels[rows, columns])
    match = codec.window(tmp_path, "match", rows, columns)
    np.testing.assert_array_equal(match["column"], LARGE.match[rows, columns, 1], strict=True)
    for name in ("exact", "mask"):
        np.testing.assert_array_equal(
            codec.window(tmp_path, name, rows, columns)[""], getattr(LARGE, name)[rows, columns], strict=True
        )


def test_a_window_reads_its_tiles_only(tmp_path: Path) -> None:
    codec.write(LARGE, tmp_path, {})
    path = tmp_path / codec.ARRAYS
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 9 // 10])  # the last tiles are missing
    window = codec.window(tmp_path, "image", slice(10, 20), slice(10, 20))
    np.testing.assert_array_equal(window["G"], LARGE.image.pixels[10:20, 10:20, 1])
    with pytest.raises(codec.ArtifactError, match="not a whole EXR file"):
        codec.window(tmp_path, "mask", slice(590, 600), slice(500, 530))


@pytest.mark.parametrize(
    ("output", "rows", "problem"),
    [
        ("image", slice(700, 800), "no pixels"),
        ("image", slice(5, 5), "no pixels"),
        ("other", slice(9), "other is missing"),
    ],
)
def test_windows_that_are_not_there(output: str, rows: slice, problem: str, tmp_path: Path) -> None:
    codec.write(LARGE, tmp_path, {})
    with pytest.raises(codec.ArtifactError, match=problem):
        codec.window(tmp_path, output, rows, slice(9))
    assert codec.sizes(tmp_path)["image"] == SHAPE
    with pytest.raises(codec.ArtifactError, match="no such file"):
        codec.window(tmp_path / "nowhere", output, rows, slice(9))
