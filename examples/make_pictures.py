"""Run the examples and make their pictures and the page that shows them: ``python -m examples.make_pictures``.

``--only 03`` runs one of them. Tests run all of them, and compare what they make with these pictures.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
PICTURES = {
    "01_first_texture.py": "01_first_texture.png",
    "02_tileable.yaml": "02_tileable/texture.png",
    "03_material.py": "03_material/preview.png",
    "04_photograph.py": "04_photograph/texture.png",
    "05_correction.py": "05_correction/texture.png",
    "06_two_materials.yaml": "06_two_materials/texture.png",
    "07_painted.yaml": "07_painted/texture.png",
    "08_plane_without_repetition.yaml": "08_plane_without_repetition/preview.png",
    "09_one_parameter.yaml": "09_one_parameter/uniformity_40_texture.png",
    "10_library.py": "10_library/textures/gravel/texture.png",
}
"""example to what of its results shows it"""
_SIDE = 384  # px of the longer side of a picture of the page


def run(example: str, folder: Path) -> Path:
    """Run an example in ``folder``, with a store of its own; its picture."""
    name = Path(example).stem
    words = [str(HERE / example)]
    if example.endswith(".yaml"):
        words = ["-m", "texloom", "run", *words, "--out", name]
    variables = {**os.environ, "TEXLOOM_STORE": str(folder / "store")}
    subprocess.run([sys.executable, *words], cwd=folder, env=variables, check=True, stdout=subprocess.DEVNULL)
    return folder / PICTURES[example]


def golden(example: str) -> Path:
    """The picture of an example on the page."""
    return HERE / "pictures" / f"{Path(example).stem}.webp"


def page() -> str:
    """The page that shows all of them."""
    lines = [
        "# Examples",
        "",
        "From the first texture to a library on a farm. Each runs by itself, in any folder, in less than half a",
        "minute: Python files by `python`, flows by `texloom run`. The exemplars ship with texloom or come with",
        "scikit-image.",
        "",
        "| | example | |",
        "|---|---|---|",
    ]
    for example in PICTURES:
        text = (HERE / example).read_text()
        head = re.match(r'"""(.+?)\n\n', text, re.DOTALL) or re.match(r"((?:# .+\n)+)", text)
        assert head is not None, f"{example} does not begin with what it is"
        about = re.sub(r"\n?# |\n", " ", head[1]).strip()
        lines.append(
            f"| {example[:2]} | [{example}]({example}): {about} | ![{example}](pictures/{golden(example).name}) |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Read the options; run, and write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", metavar="NN", default="", help="number of one example")
    options = parser.parse_args()
    for example in PICTURES:
        if example.startswith(options.only):
            with tempfile.TemporaryDirectory() as folder, Image.open(run(example, Path(folder))) as made:
                made.thumbnail((_SIDE, _SIDE))
                golden(example).parent.mkdir(exist_ok=True)
                made.convert("RGB").save(golden(example), quality=70, method=6)
    (HERE / "README.md").write_text(page())


if __name__ == "__main__":
    main()
