"""Reading pictures of the user, in a worker: decoders of broken files may take the process with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from texloom.pipelines.media.sources import Source, open_source
from texloom.pipelines.store.png_file import png
from texloom.pipelines.studio import picture_levels
from texloom.pipelines.studio.page_images import small
from texloom.pipelines.studio.work import Encoded, KeepWork, Kept, PictureWork, Places, library_of


def encode(work: PictureWork, places: Places, send: Callable[..., None]) -> None:
    """Send a picture as a PNG whose longest side is at most that of the request."""
    source = open_source("picture", library_of(places).reference(work.picture))
    send(Encoded(), png(reduced(source, work.side, places)))


def reduced(source: Source, side: int, places: Places) -> UInt8[np.ndarray, "h w 3"]:
    """The colour of a picture in sRGB, of a longest side of ``side`` px at most."""
    if picture_levels.is_large(source):
        return picture_levels.shown(source, side, places)
    return small(source.read(), side).srgb


def keep(work: KeepWork, places: Places, send: Callable[..., None]) -> None:
    """Take what was received into the library, if it can be read."""
    library, received = library_of(places), Path(work.received)
    if work.is_mesh:
        send(Kept(id=library.keep_mesh(received)))
        return

    def decode(source: Source) -> None:
        if picture_levels.is_large(source):
            picture_levels.levels_of(source, places)  # it will be looked at next
        else:
            source.read()

    picture = library.keep(received, work.name, decode)
    send(Kept(id=picture.id, picture=picture))
