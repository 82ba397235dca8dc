"""Frame stacks as sources, and their export."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from tests.aged import aged, stacked
from tests.pipelines.media.test_material_export import saved
from texloom.pipelines.media.delivery import Delivery
from texloom.pipelines.media.frame_export import write_frames
from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.media.writers.registry import WriteJob, write
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.frame_stacks import frames_of

COLORS = [np.full((6, 8, 3), 20 * number, np.uint8) for number in range(1, 12)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Frames rust_1.png to rust_11.png."""
    for number, color in enumerate(COLORS, 1):
        PIL.Image.fromarray(color).save(tmp_path / f"rust_{number}.png")
    return tmp_path


def opened(reference: object) -> Source:
    return open_source("stack", f"stack:{reference}")


@pytest.mark.parametrize("pattern", ["", "rust_*.png"])
def test_frames_come_in_the_order_of_their_numbers(folder: Path, pattern: str) -> None:
    source = opened(folder / pattern)
    image = source.read()
    assert (image.height, image.width, image.channels) == (source.height, source.width, source.channels)
    assert image.channels[:4] == ("R", "G", "B", "frame2.R")
    assert [frame.srgb[0, 0, 0] for frame in frames_of(image)] == [color[0, 0, 0] for color in COLORS]


def test_parts_of_an_exr_are_frames_and_one_picture_is_one_frame(tmp_path: Path) -> None:
    frames, _ = aged(64, 8)
    parts = [OpenEXR.Part({}, {"RGB": np.ascontiguousarray(f)}, f"t{n}") for n, f in enumerate(frames)]
    OpenEXR.File(parts).write(str(tmp_path / "all.exr"))
    read = opened(tmp_path / "all.exr").read()
    assert read.channels == stacked(frames).channels
    np.testing.assert_array_equal(read.pixels, stacked(frames).pixels)
    PIL.Image.fromarray(COLORS[0]).save(tmp_path / "one.png")
    assert opened(tmp_path / "one.png").channels == ("R", "G", "B")


def test_the_order_of_frames_is_part_of_the_digest(folder: Path) -> None:
    before = opened(folder).digest
    (folder / "rust_1.png").rename(folder / "rust_12.png")
    assert opened(folder).digest != before


@pytest.mark.parametrize(
    ("color", "message"),
    [
        (np.zeros((6, 9, 3), np.uint8), "rust_3.png has 9 x 6 px, rust_1.png 8 x 6 px"),
        (np.zeros((6, 8), np.uint8), "rust_3.png has Y as channels, rust_1.png R G B"),
    ],
)
def test_frames_that_differ_are_refused_by_name(folder: Path, color: np.ndarray, message: str) -> None:
    PIL.Image.fromarray(color).save(folder / "rust_3.png")
    with pytest.raises(InputError, match=f"all frames must be alike: {message}"):
        opened(folder)


def test_limits_are_told_before_anything_is_decoded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "rust_5.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"rust_5\.png is not a picture"):
        opened(folder)
    (folder / "rust_5.png").unlink()
    monkeypatch.setenv("TEXLOOM_MEMORY", "10kB")
    with pytest.raises(InputError, match=r"takes up to .* of memory"):
        opened(folder)
    monkeypatch.delenv("TEXLOOM_MEMORY")
    for number in range(129):
        PIL.Image.fromarray(COLORS[0]).save(folder / f"more_{number}.png")
    with pytest.raises(InputError, match="has 139 frames, at most 128"):
        opened(folder)
    with pytest.raises(InputError, match="holds no picture"):
        opened(folder / "other_*.png")
    with pytest.raises(InputError, match="no such file"):
        opened(folder / "other.png")


def test_every_frame_is_exported_as_it_came(folder: Path, tmp_path: Path) -> None:
    source = opened(folder)
    written = write_frames(source.read(), tmp_path / "out", source.maps, {}, Delivery())
    assert list(written) == [f"rust_{number}.png" for number in range(1, 12)]
    for name in written:
        np.testing.assert_array_equal(saved(tmp_path / "out" / name), saved(folder / name))
    assert "frame_04.png" in write_frames(source.read(), tmp_path / "unnamed", (), {}, Delivery())


def test_a_webp_of_a_stack_is_an_animation(folder: Path, tmp_path: Path) -> None:
    write(WriteJob(tmp_path / "all.webp", opened(folder).read(), Image, {}))
    with PIL.Image.open(tmp_path / "all.webp") as animation:
        assert getattr(animation, "n_frames", 1) == len(COLORS)
