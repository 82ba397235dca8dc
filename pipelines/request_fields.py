"""What the fields of a request mean; without pydantic, as the help of the command line needs it at once."""

MOST_SEEDS = 1000
"""of a run"""
ABOUT = {
    "flow": "A flow that ships with texloom or a plug-in, by its name, or a YAML file.",
    "pictures": "Pictures, folders and quoted patterns for the flow's first source; several make a set.",
    "sources": (
        "Take another picture as a source of the flow: PNG, JPEG, TIFF, EXR ..., or one that ships, such as "
        "texloom:bricks or skimage:gravel."
    ),
    "params": (
        "Change a param of the flow, see `texloom flows NAME`, or of a step, such as texture.patch_size=12; lists "
        "are written a,b,c or none, entries of a mapping texture.weights.height=0."
    ),
    "exports": "Also write another file, such as edges.png=edges.strength; `texloom stages STAGE` lists outputs.",
    "size": "Size of the result, px: 1024, or 2048x1024 for 2048 wide and 1024 high; short for --set size=...",
    "tileable": (
        "The result continues across all its borders (both), left and right alone (x), top and bottom alone (y) or "
        "none (off); without a value both; short for --set tileable=..."
    ),
    "preset": "Values for many params at once; short for --set preset=NAME.",
    "seed": "Random seed; the same seed gives the same bits.",
    "seeds": "Run with N seeds from --seed on, or with those from A to B, and make a contact sheet.",
    "item": "Run only this item of a set, and no step that gathers, as the lines of `texloom commands` do.",
    "store": (
        "Folder of the results; also TEXLOOM_STORE.  [default: artifacts, if there is such a folder here, empty or "
        "a store, else one in the user's cache folder]"
    ),
    "out": (
        "Folder of the exports, or a picture, as result.png, for the main result alone.  [default: ./PICTURE_FLOW]"
    ),
    "force": "Replace files in --out that texloom did not write, or that were changed since.",
    "runner": (
        "What computes the steps. local: this process, one item after the other; the default. threads, processes: "
        "several steps at a time on this machine. dask: the workers of a cluster. With PREFECT_API_URL set, the "
        "server there shows the run."
    ),
    "workers": (
        "How many steps at a time, for threads, processes and dask; they share the processors.  [default: what "
        "processors and memory allow]"
    ),
    "address": "Address of the scheduler of a running Dask cluster; without it, --runner dask starts one here.",
    "layout": (
        "Write material sets with the file names, packed channels, normals and bits of a program: unreal, unity, "
        "blender, gltf, arnold, substance."
    ),
    "texel_size": (
        "Side of a pixel, such as 0.5mm: the size of the result in MaterialX, USD, glTF, EXR and tx, and the "
        "depth of its displacement."
    ),
    "color_space": "Colour space of EXR and tx: rec709 (linear), the default, or acescg.",
    "udim": "Cut the maps of a layout into tiles, such as 3x2, with 1001 at the lower left.",
}
"""field of `texloom.pipelines.request.RunRequest` to its help"""

DELIVERY = ("layout", "texel_size", "color_space", "udim")
RUNNER = ("runner", "workers", "address")
SHORT = ("size", "tileable", "preset")
"""the fields that stand for params of that name"""
