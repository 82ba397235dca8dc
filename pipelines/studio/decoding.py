"""Reading pictures of the user, in a worker: decoders of broken files may take the process with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store.png_file import png
from texloom.pipelines.studio.page_images import small
from texloom.pipelines.studio.work import Encoded, KeepWork, Kept, PictureWork, Places, library_of


def encode(work: PictureWork, places: Places, send: Callable[..., None]) -> None:
    """Send a picture as a PNG whose longest side is at most that of the request."""
    source = open_source("picture", library_of(places).reference(work.picture))
    send(Encoded(), png(small(source.read(), work.side).srgb))


def keep(work: KeepWork, places: Places, send: Callable[..., None]) -> None:
    """Take what was received into the library, if it can be read."""
    library, received = library_of(places), Path(work.received)
    if work.is_mesh:
        send(Kept(id=library.keep_mesh(received)))
        return
    picture = library.keep(received, work.name)
    send(Kept(id=picture.id, picture=picture))
