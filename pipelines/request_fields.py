"""How the fields of a request are given and what they mean; without pydantic, as ``--help`` needs it at once."""

from pathlib import Path
from typing import NamedTuple

MOST_SEEDS = 1000
"""of a run"""


class Option(NamedTuple):
    """A field of a request: what it means, and how the command line has it."""

    help: str
    kind: type = str
    """of the value; bool: of a flag, dict: of one NAME=VALUE of several"""
    metavar: str = ""
    flags: tuple[str, ...] = ()
    """none: the name of the field"""


OPTIONS = {
    "flow": Option("A flow that ships with texloom or a plug-in, by its name, or a YAML file."),
    "pictures": Option("Pictures, folders and quoted patterns for the flow's first source; several make a set."),
    "sources": Option(
        "Take another picture as a source of the flow: PNG, JPEG, TIFF, EXR ..., or one that ships, such as "
        "texloom:bricks or skimage:gravel.",
        kind=dict,
        metavar="NAME=PATH",
        flags=("--source",),
    ),
    "params": Option(
        "Change a param of the flow, see `texloom flows NAME`, or of a step, such as texture.patch_size=12; lists "
        "are written a,b,c or none, entries of a mapping texture.weights.height=0.",
        kind=dict,
        metavar="PARAM=VALUE",
        flags=("--set",),
    ),
    "exports": Option(
        "Also write another file, such as edges.png=edges.strength; `texloom stages STAGE` lists outputs.",
        kind=dict,
        metavar="NAME.EXT=STEP.OUTPUT",
        flags=("--export",),
    ),
    "size": Option(
        "Size of the result, px: 1024, or 2048x1024 for 2048 wide and 1024 high; short for --set size=...",
        metavar="N|WIDTHxHEIGHT",
    ),
    "tileable": Option(
        "The result continues across all its borders (both), left and right alone (x), top and bottom alone (y) or "
        "none (off); without a value both; short for --set tileable=...",
        metavar="[=x|y|both|off]",
    ),
    "preset": Option("Values for many params at once; short for --set preset=NAME.", metavar="NAME"),
    "seed": Option("Random seed; the same seed gives the same bits.", kind=int),
    "seeds": Option(
        "Run with N seeds from --seed on, or with those from A to B, and make a contact sheet.", metavar="N|A-B"
    ),
    "store": Option(
        "Folder of the results; also TEXLOOM_STORE.  [default: artifacts, if there is such a folder here, empty or "
        "a store, else one in the user's cache folder]"
    ),
    "remote": Option(
        "A shared store on object storage, as s3://BUCKET/PREFIX: results are looked up there before they are "
        "computed, and uploaded after; also TEXLOOM_REMOTE. What lies there is believed.",
        metavar="URL",
    ),
    "crop": Option(
        "Take a part of the first source, and of masks and guides of its size, px: 1024x768+200+0 for 1024 wide "
        "and 768 high, 200 from the left and 0 from the top, or 1024x768 of the middle.",
        metavar="WIDTHxHEIGHT[+LEFT+TOP]",
    ),
    "reduce": Option(
        "Make these smaller by a factor on the sides, such as 0.5, after --crop; pixels are then so much larger "
        "than --texel-size.",
        metavar="FACTOR",
    ),
    "layout": Option(
        "Write material sets with the file names, packed channels, normals and bits of a program: unreal, unity, "
        "blender, gltf, arnold, substance.",
        metavar="NAME",
    ),
    "texel_size": Option(
        "Side of a pixel, such as 0.5mm: the size of the result in MaterialX, USD, glTF, EXR and tx, and the "
        "depth of its displacement.",
        metavar="LENGTH",
    ),
    "color_space": Option("Colour space of EXR and tx: rec709 (linear), the default, or acescg.", metavar="NAME"),
    "udim": Option(
        "Cut the maps of a layout into tiles, such as 3x2, with 1001 at the lower left.", metavar="COLUMNSxROWS"
    ),
    "material": Option(
        "Name of the material, with which files of a layout begin.  [default: that of its pictures]",
        metavar="NAME",
    ),
    "out": Option(
        "Folder of the exports, or a picture, as result.png, for the main result alone.  [default: ./PICTURE_FLOW]",
        kind=Path,
        metavar="FOLDER|PICTURE",
        flags=("--out", "-o"),
    ),
    "force": Option("Replace files in --out that texloom did not write, or that were changed since.", kind=bool),
    "keep": Option(
        "all: every step's result stays in the store; final: only those that are exported, gathered or that no "
        "step takes, and of the others what is needed to find them cached.  [default: as the flow says, else all]",
        metavar="all|final",
    ),
    "runner": Option(
        "What computes the steps. local: this process, one item after the other; the default. threads, processes: "
        "several steps at a time on this machine. dask: the workers of a cluster. With PREFECT_API_URL set, the "
        "server there shows the run.",
        metavar="NAME",
    ),
    "workers": Option(
        "How many steps at a time, for threads, processes and dask; they share the processors.  [default: what "
        "processors and memory allow]",
        kind=int,
        metavar="N",
    ),
    "address": Option(
        "Address of the scheduler of a running Dask cluster; without it, --runner dask starts one here.",
        metavar="tcp://HOST:PORT",
    ),
    "item": Option(
        "Run only this item of a set, and no step that gathers, as the lines of `texloom commands` do.",
        metavar="NAME",
    ),
}
"""the fields of `texloom.pipelines.request.RunRequest`, in the order of ``--help``"""

PART = ("crop", "reduce")
DELIVERY = ("layout", "texel_size", "color_space", "udim", "material")
RUNNER = ("runner", "workers", "address")
SHORT = ("size", "tileable", "preset")
"""the fields that stand for params of that name"""
