"""The pictures that the page may use: those of the folder, those that were dropped, those that ship."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from texloom.pipelines.errors import one_line
from texloom.pipelines.media.cameras import is_of_a_camera
from texloom.pipelines.media.formats import SUFFIXES as PICTURES
from texloom.pipelines.media.locate import shipped_pictures
from texloom.pipelines.media.meshes import SUFFIXES
from texloom.pipelines.media.shapes import SHAPES
from texloom.pipelines.media.sources import Source, open_mesh, open_source
from texloom.pipelines.store.atomic import file_digest, write_atomically
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.listing import DROPPED, Listed, PictureSorting, chosen, folders_of, scan
from texloom.pipelines.studio.messages.catalogue import Picture, PicturePage
from texloom.stages.vocabulary.declare import InputError

MOST_BYTES = 2**29
"""of a dropped file"""
_MOST_PICTURES = 200  # listed at a time
PAGE = 60
"""pictures that are listed at a time where nobody says otherwise"""
PROJECT = "texloom_project"
"""the folder of a project's own files, which are no pictures to start from"""
_MOST_LOOKED_AT = 5000  # entries of a folder
_MATERIAL = "maps"
_PAINTED = "painted_"
"""begins the name of what the page paints, which is no exemplar"""
GEOMETRY = f"{_PAINTED}geometry.yaml"
"""the name of geometry files that the page makes; the pictures beside one are its areas"""
_KEPT = 16  # hexadecimal digits of the folder of what was dropped
_EXAMPLES = ("texloom:bricks", "shipped:brick_maps", "texloom:plaster", "skimage:gravel", "skimage:grass")
_MESHES = tuple(f"texloom:{name}" for name in SHAPES)
_SHIPPED = Path(__file__).parents[2] / "configs" / "exemplars"


class Library:
    """Finds pictures of a folder, those that were dropped into the store, and results of runs; no other files."""

    def __init__(self, folder: Path, store: Path, **others: Path):
        roots = {"folder": folder, "dropped": store / "sources", "run": store / "runs", "shipped": _SHIPPED}
        self._store = Store(store)
        self.roots = {scheme: root.resolve() for scheme, root in (roots | others).items()}

    def reference(self, picture: str) -> str:
        """What a flow file calls a picture; `InputError` where there is none of that id, or it lies elsewhere."""
        scheme, _, path = picture.partition(":")
        if scheme not in self.roots:
            if picture in (*shipped_pictures(), *_MESHES):
                return picture
            raise InputError(one_line(f"{picture}: no such picture"))
        root = self.roots[scheme]
        try:
            found = (root / path).resolve(strict=True)
        except (OSError, ValueError, RuntimeError):
            raise InputError(one_line(f"{path}: is no longer there; drop it again or choose another")) from None
        if not found.is_relative_to(root) or found == root:
            raise InputError(one_line(f"{path}: is not in the folder of the studio"))
        return str(found)

    def picture(self, picture: str) -> Picture:
        """A picture by its id; `InputError` where it cannot be read."""
        source = open_source("picture", self.reference(picture))
        return _described(picture, source)

    def name_of(self, picture: str) -> str:
        """What a picture is called, without reading it; `InputError` where there is none of that id."""
        self.reference(picture)
        name = picture.rpartition("/")[2].rpartition(":")[2]
        return Path(name).stem if Path(name).suffix.lower() in PICTURES else name

    def pictures(
        self,
        search: str = "",
        folder: str = "",
        sorting: PictureSorting = "name",
        first: int = 0,
        count: int = PAGE,
    ) -> PicturePage:
        """Some of the pictures of the folder and of those that were dropped, and what is not shown of them."""
        made = scan(self.roots["folder"], without=(self._store.root, self.roots["folder"] / PROJECT))
        every = [*made.found, *self._listed_dropped()]
        found = chosen(every, search, folder, sorting)
        asked = [one.id for one in found[max(0, first) :][: min(max(1, count), _MOST_PICTURES)]]
        shown = tuple(self._readable(asked))
        unread = len(asked) - len(shown)
        notes = (f"{unread} of these cannot be read",) if unread else ()
        return PicturePage(
            pictures=shown, asked=len(asked), found=len(found), total=len(every), folders=folders_of(every),
            notes=(*notes, *made.notes),
        )  # fmt: skip

    def _listed_dropped(self) -> Iterator[Listed]:
        for own in self._dropped():
            for path in _entries(own):
                if not path.name.startswith(_PAINTED) and path.suffix.lower() not in SUFFIXES:
                    yield Listed(f"dropped:{own.name}/{path.name}", DROPPED, path.lstat().st_mtime)

    def examples(self) -> list[Picture]:
        """Some of the pictures that ship."""
        return list(self._readable(list(_EXAMPLES)))

    def meshes(self) -> list[str]:
        """The meshes that ship, those of the folder, and those that were dropped."""
        folders = [("folder", self.roots["folder"]), *(("dropped", own) for own in self._dropped())]
        found = [
            f"{scheme}:{path.relative_to(self.roots[scheme])}"
            for scheme, folder in folders
            for path in _entries(folder)
            if path.suffix.lower() in SUFFIXES and path.is_file()
        ]
        return [*_MESHES, *found[:_MOST_PICTURES]]

    def _dropped(self) -> list[Path]:
        """The folders of what was dropped."""
        return [own for own in _entries(self.roots["dropped"]) if own.is_dir() and len(own.name) == _KEPT]

    def _readable(self, ids: list[str]) -> Iterator[Picture]:
        for one in ids[:_MOST_PICTURES]:
            try:
                yield self.picture(one)
            except InputError:
                continue

    # -- dropping

    def dropped(self) -> Path:
        """The folder of what was dropped, made if need be."""
        self._store.ready("sources")
        return self.roots["dropped"]

    def new_folder(self) -> Path:
        """A folder for files that are being received; `keep` or `discard` it."""
        folder = self.dropped() / f".new-{secrets.token_hex(8)}"
        folder.mkdir()
        return folder

    def keep(self, received: Path, name: str, decode: Callable[[Source], object]) -> Picture:
        """Keep what was received: one picture, or the maps of a material that is called ``name``.

        ``decode`` reads it once, so that a broken file is refused. Equal files get the same folder. `InputError`
        where they cannot be read; then they are removed.
        """
        with _received(received) as files:
            place = files[0].name
            if len(files) > 1:
                inner = received / (safe_name(name) or _MATERIAL)
                inner.mkdir()
                for path in files:
                    path.rename(inner / path.name)
                place = inner.name
            source = open_source("dropped", str(received / place))
            decode(source)
            described = _described("", source)  # while it is there
            return described.model_copy(update={"id": self.take(received, place)})

    def keep_mesh(self, received: Path) -> str:
        """Keep a mesh that was received; its id. `InputError` where it cannot be read; then it is removed."""
        with _received(received) as files:
            open_mesh("dropped", str(files[0])).value()
            return self.take(received, files[0].name)

    def take(self, received: Path, place: str) -> str:
        """Keep a folder under the digest of its files; the id of one of them, or of a folder inside."""
        files = sorted(path for path in received.rglob("*") if path.is_file())
        own = self._own("".join(f"{path.name}:{file_digest(path)};" for path in files).encode())
        if not own.exists():
            received.rename(own)
        return f"dropped:{own.name}/{place}"

    def keep_document(self, content: bytes, name: str) -> str:
        """Keep a document that the page has made; its id."""
        self.dropped()
        path = self._own(content) / f"{_PAINTED}{safe_name(name)}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content)
        return f"dropped:{path.parent.name}/{path.name}"

    def _own(self, content: bytes) -> Path:
        """The folder of what has this content."""
        return self.roots["dropped"] / hashlib.sha256(content).hexdigest()[:_KEPT]


def safe_name(name: str) -> str:
    """The last part of a path as a name for a file, without what some systems or shells would take otherwise."""
    last = re.split(r"[/\\]", name)[-1]
    return re.sub(r"[^\w. -]", "_", last).lstrip(".")[-100:].strip()


def is_painted(picture: str) -> bool:
    """Whether the page has painted a picture, by its id."""
    return picture.rpartition("/")[2].startswith(_PAINTED)


@contextlib.contextmanager
def _received(folder: Path) -> Iterator[list[Path]]:
    """The files of a folder, which is removed afterwards; errors do not name it."""
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file())
        if not files:
            raise InputError("nothing was received")
        yield files
    except InputError as error:
        raise InputError(str(error).replace(f"{folder}{os.sep}", "").removeprefix("sources.dropped: ")) from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _described(picture: str, source: Source) -> Picture:
    return Picture(
        id=picture,
        name=source.picture,
        height=source.height,
        width=source.width,
        is_material=bool(source.maps),
        is_photograph=is_of_a_camera(Path(source.reference)),
    )


def _entries(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return sorted(Path(entry.path) for entry in itertools.islice(entries, _MOST_LOOKED_AT))
    except OSError:
        return []
