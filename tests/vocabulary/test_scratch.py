"""Arrays in files give the same results as arrays in memory."""

from __future__ import annotations

import errno
import os
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from texloom.pipelines.store import codec, exr
from texloom.stages.kernels.core.threads import sharing
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary import scratch
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import USABLE
from texloom.stages.vocabulary.scratch import Scratch, bands, empty, release, run_bands, using


def test_large_arrays_are_in_files_without_a_name(tmp_path: Path) -> None:
    with using(Scratch(tmp_path, 1000)):
        small, large = empty((10, 10), np.float64), empty((20, 10), np.float64)
    assert isinstance(large.base, np.ndarray)
    assert small.base is None
    assert not list(tmp_path.iterdir())
    large[:] = values = np.arange(200.0).reshape(20, 10)
    release(large, small)
    np.testing.assert_array_equal(large, values)


@pytest.mark.parametrize(("number", "is_refused"), [(errno.ENOSPC, True), (errno.EOPNOTSUPP, False)])
def test_a_full_disk_is_an_error(
    number: int, is_refused: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "posix_fallocate", fail, raising=False)
    with using(Scratch(tmp_path, 0)), pytest.raises(OSError, match="space") if is_refused else nullcontext():
        assert not empty((3, 5), np.uint8).any()


def test_bands_cover_all_rows(tmp_path: Path) -> None:
    with using(Scratch(tmp_path, 0)):
        array = empty((200, 3), np.int64)
        for band in bands(200, array):
            array[band] = np.arange(200)[band, None]

        def double(first: int, last: int) -> int:
            array[first:last] *= 2
            return last - first

        assert sum(run_bands(double, (), 200, [array])) == 200
    np.testing.assert_array_equal(array, np.tile(2 * np.arange(200)[:, None], 3))


MAPS = (*"RGB", "height", "normal.X", "normal.Y", "normal.Z")


@pytest.mark.parametrize("rows", [7, 64])
@pytest.mark.parametrize(
    ("tileable", "channels", "generators"),
    [(False, "RGB", None), (True, "RGB", [[8, 0], [0, 12]]), (True, MAPS, None), (False, "Y", [[8, 0]])],
)
def test_a_texture_in_files_has_the_same_bits(
    tileable: bool,
    channels: tuple[str, ...],
    generators: list[list[int]] | None,
    rows: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(5)
    exemplar = Image(rng.random((40, 48, len(channels)), np.float32), tuple(channels))
    exemplar.pixels[9:16, 20:30] = 0.9
    lattice = None if generators is None else np.array(generators, np.float32)

    def made() -> list[np.ndarray]:
        start = find_stage("synthesis.initialise").function(
            image=exemplar,
            params=InitialiseParams(size=(150, 70)),
            rng=np.random.default_rng(1),
            generators=lattice,
        )
        done = find_stage("synthesis.optimise").function(
            image=exemplar,
            start=start.match,
            params=OptimiseParams(preset="fast", tileable=tileable, regularity=30, coarsest=16),
            rng=np.random.default_rng(2),
            generators=lattice,
            guidance=exemplar.pixels[..., 0] * 50,
        )
        return [start.match, start.image.pixels, done.image.pixels, done.match, done.occurrence]

    plain = made()
    monkeypatch.setattr(scratch, "_BAND", rows)
    with using(Scratch(tmp_path, 0)):
        in_files = made()
    for one, other in zip(plain, in_files, strict=True):
        np.testing.assert_array_equal(one, other, strict=True)


@pytest.mark.parametrize("threads", [1, 2])
def test_masks_and_guides_in_files_on_any_number_of_threads(threads: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    exemplar = Image(rng.random((40, 48, 2), np.float32), ("Y", USABLE))
    exemplar.pixels[..., 1] = 1
    exemplar.pixels[5:12, 30:40, 1] = 0
    guide, target = (np.linspace(0, 30, side, dtype=np.float32)[:, None, None] for side in (40, 150))
    guides = {"exemplar_guide": guide.repeat(48, axis=1), "target_guide": target.repeat(70, axis=1)}
    keep = np.zeros((150, 70), bool)
    keep[60:90, 20:50] = True

    def made() -> list[np.ndarray]:
        start = find_stage("synthesis.initialise").function(
            image=exemplar, params=InitialiseParams(size=(150, 70)), rng=np.random.default_rng(1), **guides
        )
        done = find_stage("synthesis.optimise").function(
            image=exemplar,
            start=start.match,
            params=OptimiseParams(preset="fast", coarsest=16),
            rng=np.random.default_rng(2),
            keep=keep,
            **guides,
        )
        return [start.match, start.image.pixels, done.image.pixels, done.match, done.occurrence]

    plain = made()
    with using(Scratch(tmp_path, 0)), sharing(threads):
        in_files = made()
    for one, other in zip(plain, in_files, strict=True):
        np.testing.assert_array_equal(one, other, strict=True)


def test_results_in_files_are_stored_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr, "TILED", 2**12)
    result = find_stage("synthesis.initialise").function(
        image=Image(np.random.default_rng(0).random((32, 32, 3), np.float32), ("R", "G", "B")),
        params=InitialiseParams(size=(300, 270)),
        rng=np.random.default_rng(1),
    )
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        folder.mkdir()
    codec.write(result, folders[0], {})
    digests = codec.digests(result)
    with using(Scratch(tmp_path, 0)):
        read = type(result)(**codec.read(type(result), folders[0]))
        assert codec.digests(read) == digests
        codec.write(read, folders[1], {})
    assert (folders[0] / codec.ARRAYS).read_bytes() == (folders[1] / codec.ARRAYS).read_bytes()
