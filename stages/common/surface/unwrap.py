"""New texture coordinates by xatlas, in a process of its own: where xatlas fails it ends its process.

``python -m texloom.stages.common.surface.unwrap IN OUT`` is that process; both files are NumPy archives.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt32

_PADDING = 4  # px between charts


class UnwrapError(Exception):
    """xatlas could not cut the mesh."""


def unwrapped(
    points: Float32[np.ndarray, "vertices 3"],
    normals: Float32[np.ndarray, "vertices 3"],
    faces: UInt32[np.ndarray, "faces 3"],
    side: int,
) -> Float32[np.ndarray, "corners 2"]:
    """Texture coordinates of the faces' corners, 0..1, charts in proportion and apart in a texture of ``side`` px.

    Raises
    ------
    UnwrapError : xatlas failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "in.npz", Path(folder) / "out.npy"
        np.savez(given, points=points, normals=normals, faces=faces, side=side)
        command = [sys.executable, "-P", "-m", __name__, str(given), str(made)]
        done = subprocess.run(command, capture_output=True, check=False)  # noqa: S603
        if done.returncode or not made.exists():
            raise UnwrapError(f"xatlas ended with code {done.returncode}")
        texture: Float32[np.ndarray, "corners 2"] = np.load(made)
    return texture


def main(given: str, made: str) -> None:
    """Read a mesh and write its texture coordinates."""
    import xatlas

    with np.load(given) as mesh:
        atlas, pack = xatlas.Atlas(), xatlas.PackOptions()
        pack.resolution, pack.padding, pack.bilinear = int(mesh["side"]), _PADDING, True
        atlas.add_mesh(mesh["points"], mesh["faces"], mesh["normals"])
    atlas.generate(xatlas.ChartOptions(), pack)
    _, indices, texture = atlas[0]
    # charts keep their proportions in an atlas that is not square
    sides = np.array([atlas.width, atlas.height], np.float64) / max(atlas.width, atlas.height)
    np.save(made, (texture[indices.ravel()] * sides).astype(np.float32))


if __name__ == "__main__":
    main(*sys.argv[1:])
