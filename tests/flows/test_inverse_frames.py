"""A stack of frames, compacted and made again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.aged import aged
from tests.pipelines.media.test_material_export import saved
from tests.pipelines.media.test_material_set import save
from texloom.pipelines.store.png_file import png


def test_every_pixel_of_a_compaction_has_a_whole_history(ran: Any, tmp_path: Path) -> None:
    frames, control = aged(9, 64)
    (tmp_path / "frames").mkdir()
    for number, frame in enumerate(frames):
        codes = np.rint(np.clip(frame, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
        (tmp_path / "frames" / f"t{number}.png").write_bytes(png(codes))
    save(tmp_path / "control.png", np.rint(control[::2, ::2] * 255).astype(np.uint8))  # coarser than the frames
    sources = {"stack": tmp_path / "frames", "control": tmp_path / "control.png"}
    exports = ran(tmp_path / "out", "inverse_frames", sources, size="32x32", preset="fast")
    names = sorted(path.name for path in exports["frames/"].iterdir())
    assert names == [f"t{number}.png" for number in range(9)]
    small, large = (
        np.concatenate([saved(folder / name) for name in names], axis=2).reshape(-1, 27)
        for folder in (exports["frames/"], tmp_path / "frames")
    )
    assert {bytes(row) for row in small} <= {bytes(row) for row in large}
    differences = [one["distance"] for one in exports["differences.json"]]
    assert len(differences) == 9
    assert max(differences) < 25
    assert exports["scores.json"]["compaction"]["value"] < exports["scores.json"]["crop"]["value"]
    page = exports["report.html"].read_text()
    assert page.count("data:image/webp") >= 3 * 9
