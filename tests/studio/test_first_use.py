"""What an artist does first, in a browser, and how many choices that takes: drops, clicks and picks of a list."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import PIL.Image
import pytest
import skimage

from tests.studio.conftest import Watched

CAMERA = 0x010F  # the tag of Exif for who made it


class Choices:
    """Counts what is chosen."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, choose: Callable[..., Any], *given: Any) -> None:
        choose(*given)
        self.count += 1


def photograph(path: Path) -> None:
    """A wall in perspective, as a camera would write it."""
    exif = PIL.Image.Exif()
    exif[CAMERA] = "A camera"
    PIL.Image.fromarray(skimage.data.brick()[:288, :288]).convert("RGB").save(path, quality=95, exif=exif)


@pytest.mark.long
def test_a_photograph_to_unreal_in_six_choices_and_a_correction_in_three(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    settings = page.get_by_label("Settings")
    photograph(tmp_path / "street.jpg")
    choose = Choices()
    choose(page.locator("make-view").get_by_label("Choose pictures").set_input_files, tmp_path / "street.jpg")
    choose(page.get_by_role("button", name="256", exact=True).click)
    choose(settings.get_by_label("Preset").select_option, "fast")
    choose(settings.get_by_role("button", name="Finish at full size").click)
    settings.get_by_text("Done in").wait_for()
    with page.expect_download() as maps:
        choose(settings.get_by_label("Download maps for a program").select_option, "unreal")
    assert choose.count <= 6
    with zipfile.ZipFile(maps.value.path()) as archive:
        assert {one.rpartition("_")[2] for one in archive.namelist()} >= {"BC.png", "N.png", "ORM.png"}
        names = {Path(one).name for one in archive.namelist()}
    assert all(one.startswith("T_street_") for one in names)
    choose = Choices()
    choose(page.get_by_role("button", name="Correct a spot").click)
    choose(page.get_by_label("Worst places").get_by_role("button").first.click)
    page.get_by_role("radio", name="Version 1").wait_for()
    choose(page.get_by_role("button", name="Accept").click)
    page.get_by_text("Full size, corrected").wait_for()
    assert choose.count <= 3
