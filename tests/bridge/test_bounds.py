"""What the server keeps of the pictures that it was sent."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from texloom.pipelines.studio import hosts
from texloom.pipelines.studio.hosts import HostRuns
from texloom.pipelines.studio.messages.hosts import OnePicture, PixelFormat, Submitted
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> HostRuns:
    monkeypatch.setattr(hosts, "MOST_KEPT", 3)
    monkeypatch.setattr(hosts, "MOST_KEPT_BYTES", 100)
    monkeypatch.setattr(hosts, "MOST_WAITING_BYTES", 150)
    return HostRuns(Places(folder=str(tmp_path), store=str(tmp_path), scratch=str(tmp_path)))


def sent(runs: HostRuns, size: int) -> str:
    file = runs.new_file("")
    file.write_bytes(bytes(size))
    return runs.keep(file, PixelFormat(shape=(1, size), dtype="uint8", color_space="srgb"))


def asked(*pictures: str) -> Submitted:
    return Submitted(flow="quilting", sources={f"s{n}": OnePicture(picture=one) for n, one in enumerate(pictures)})


def test_pictures_are_bounded_by_number_and_bytes(runs: HostRuns, tmp_path: Path) -> None:
    small = [sent(runs, 1) for _ in range(5)]
    assert list(runs.received) == small[2:]
    large = sent(runs, 98)
    assert list(runs.received) == [*small[3:], large]
    larger = sent(runs, 120)  # the latest one is always kept
    assert list(runs.received) == [larger]
    assert [one.name for one in tmp_path.iterdir()] == [larger]
    with pytest.raises(InputError, match=r"or is gone: the latest 3 are kept, of at most \S+ GiB; send it again"):
        runs.submit(asked(large))


async def submit(runs: HostRuns, *pictures: str) -> None:
    runs.submit(asked(*pictures))


def test_pictures_of_waiting_runs_stay_and_are_bounded(runs: HostRuns) -> None:
    first = sent(runs, 90)
    asyncio.run(submit(runs, first))
    second = sent(runs, 90)
    assert list(runs.received) == [first, second]
    asyncio.run(submit(runs, second))
    with pytest.raises(InputError, match=r"the pictures of runs that wait take more than .* GiB; wait for one"):
        sent(runs, 1)
    assert list(runs.received) == [first, second]
