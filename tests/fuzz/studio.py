"""Messages of a page of the studio, damaged: each is answered, or refused by one line."""

from __future__ import annotations

import copy
import json
import random
import tempfile
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import PIL.Image

from tests.fuzz.mutations import mutated, mutated_text
from texloom.pipelines.studio import reduced_recipes
from texloom.pipelines.studio.lattices import Lattices
from texloom.pipelines.studio.messages.message import unpacked
from texloom.pipelines.studio.messages.requests import (
    TO_SERVER,
    AlternativesRequest,
    LatticeRequest,
    PaintDabRequest,
    PaintOpenRequest,
    PaintSummaryRequest,
    PhotoRequest,
    PreviewRequest,
)
from texloom.pipelines.studio.painting import Painter
from texloom.pipelines.studio.photographs import Photographer
from texloom.pipelines.studio.previews import Previewer
from texloom.pipelines.studio.recipe_flows import open_recipe
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.declare import InputError

_RECIPE = {"flow": "quilting", "sources": {"exemplar": "folder:a.png"}, "size": "32x32", "seed": 3}
_SQUARE = [[2, 2], [2, 20], [20, 20], [20, 2]]
_REQUESTS: tuple[dict[str, Any], ...] = (
    {"kind": "preview", "number": 1, "recipe": {**_RECIPE, "tileable": "x", "params": {"texture.overlap": 0.25}}},
    {"kind": "preview", "number": 1, "recipe": {**_RECIPE, "mask": "folder:b.png"}},
    {
        "kind": "preview", "number": 1, "attached": {"lattice.json": 2},
        "recipe": {**_RECIPE, "files": {"texture.block": "attached:lattice.json"}},
    },
    {
        "kind": "alternatives", "number": 2, "seeds": [1, 2],
        "recipe": {"flow": "revise", "sources": dict.fromkeys(("texture", "exemplar", "region"), "folder:a.png")},
    },
    {"kind": "paint_open", "number": 3, "texture": "folder:a.png", "control": "folder:b.png", "size": "24x20"},
    {"kind": "paint_summary", "number": 7, "texture": "folder:a.png", "control": "folder:b.png"},
    {"kind": "paint_dab", "number": 4, "top": 2, "left": 3, "height": 4, "width": 5},
    {
        "kind": "photo", "number": 5, "patch": "wall", "side": 16,
        "recipe": {
            "photo": "folder:a.png",
            "patches": [{"name": "wall", "corners": _SQUARE, "size": "8x8"}],
            "areas": {"region": [{"tool": "stroke", "points": [[3, 4], [9, 9]], "radius": 2}]},
        },
    },
    {
        "kind": "lattice", "number": 6, "picture": "folder:a.png",
        "lattice": {
            "vertices": [[0, 0, 4, 4], [0, 1, 4, 14], [1, 0, 14, 4], [1, 1, 14, 14]],
            "generators": [[10, 0], [0, 10]],
        },
    },
)  # fmt: skip
_VALUES = (
    None, True, 0, 1, -1, 2, 64, 2**31, 2**53, 1e308, 0.5, float("nan"), float("inf"), "", "a", "wall",
    "folder:a.png", "folder:../a.png", "folder:a\n\x1b[31m.png", "texloom:bricks", "attached:lattice.json",
    "quilting", "values", [], {}, [[]], [1, 1], [32, 32], [2048, 1], {"a": 1}, [[0, 0, 0, 0]] * 3,
)  # fmt: skip
_SIDE = 96  # px of a preview, at most; without a size, one is as large as its method makes it
_PIXELS = {"paint_open": 480, "paint_dab": 20}


class _Workers:
    """What a page's worker processes hold, in this process."""

    def __init__(self) -> None:
        folder = Path(tempfile.mkdtemp())
        row, column = np.indices((40, 48))
        spots = np.uint8(60 * ((row // 5 + column // 6) % 3))
        PIL.Image.fromarray(np.dstack([spots, 255 - spots, spots // 2])).save(folder / "a.png")
        PIL.Image.fromarray(np.uint8(row * 6)).save(folder / "b.png")
        places = Places(folder=str(folder), store=str(folder / "store"), scratch=str(folder / "scratch"))
        self.previewer, self.painter = Previewer(places), Painter(places)
        self.photographer, self.lattices = Photographer(places), Lattices(places)

    def answer(self, frame: bytes) -> None:
        try:
            header, payload = unpacked(frame)
            request = TO_SERVER.validate_json(header)
        except ValueError:
            raise InputError("not a message of the studio") from None
        match request:
            case PreviewRequest():
                with patch.object(reduced_recipes, "_LARGEST_RESULT", _SIDE):
                    self.previewer.make(request, bytes(payload), _go_on, _send)
            case AlternativesRequest():
                open_recipe(request.recipe, self.previewer.library, self.previewer.store).plan()
            case PaintOpenRequest():
                self.painter.open(request, bytes(payload), _go_on, _send)
            case PaintSummaryRequest():
                self.painter.summarise(request, _go_on, _send)
            case PaintDabRequest():
                self.painter.paint(request, bytes(payload), _send)
            case PhotoRequest():
                self.photographer.answer(request, _go_on, _send)
            case LatticeRequest():
                self.lattices.follow(request, _send)


_workers = cache(_Workers)


def messages(rng: random.Random, _: Path) -> None:
    """Requests of a page with other values, or damaged frames."""
    request = copy.deepcopy(rng.choice(_REQUESTS))
    payload = bytes(_PIXELS.get(request["kind"], 2))
    if rng.random() < 0.7:
        _change(rng, request)
    header = json.dumps(request)
    if rng.random() < 0.2:
        header = mutated_text(rng, header)
    content = header.encode(errors="surrogatepass")
    frame = len(content).to_bytes(4, "little") + content + payload
    _workers().answer(mutated(rng, frame) if rng.random() < 0.1 else frame)


def _change(rng: random.Random, within: Any) -> None:
    """Replace or remove one value at any depth."""
    keys = list(within) if isinstance(within, dict) else range(len(within))
    key = rng.choice(keys)
    if isinstance(within[key], dict | list) and within[key] and rng.random() < 0.8:
        _change(rng, within[key])
    elif rng.random() < 0.2:
        del within[key]
    else:
        old = within[key]
        moved = (
            old * rng.uniform(-2, 3)
            if isinstance(old, float)
            else old + rng.choice((-1, 1))
            if isinstance(old, int)
            else ""
        )
        within[key] = rng.choice((*_VALUES, *[moved] * 20))


def _go_on() -> None:
    """Nothing cancels the work."""


def _send(*_: object) -> None:
    """The page is not shown what comes."""
