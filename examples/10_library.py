"""A library on a farm: one command for each picture, in any order, on any machines that share the store.

    python examples/10_library.py

The last command gathers the scores and pictures of all. Here all of them run on this machine, one after the other.
"""

import shlex
import subprocess
import sys
from pathlib import Path

import skimage.data
import skimage.io

here = Path("10_library").absolute()
(here / "pictures").mkdir(parents=True, exist_ok=True)
for name in ("brick", "gravel", "grass"):
    skimage.io.imsave(here / "pictures" / f"{name}.png", getattr(skimage.data, name)()[:192, :192])

texloom = [sys.executable, "-m", "texloom"]
request = ["self_tuning", str(here / "pictures/*.png"), "--size", "192", "--preset", "fast"]
places = ["--store", str(here / "store"), "--out", str(here / "textures")]
lines = subprocess.run([*texloom, "commands", *request, *places], check=True, capture_output=True, text=True).stdout
for line in lines.splitlines():
    subprocess.run([*texloom, *shlex.split(line)[1:]], check=True)
