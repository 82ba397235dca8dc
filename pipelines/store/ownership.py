"""Whose a store is: a folder is one only by a marker that texloom wrote for this user.

``markers/<key id>`` holds the store's identity and an HMAC of it under a random key, which is in the user's
configuration folder and never leaves it. So nobody else can make a folder look like a store of this user, and a
limit that somebody else wrote does not apply. Several users may have adopted one store, each with a marker. Workers
of a cluster have no key: the run that they work for tells them the identity.

What is in the user's own cache folder for texloom needs no marker at first: nobody else can write there.
Where no key can be kept, as in a home folder that is read-only, a folder with an ``identity`` is used, but nothing
is ever removed from it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import hmac
import json
import os
import re
import secrets
import shlex
import stat
from pathlib import Path

from texloom.pipelines.errors import refused
from texloom.pipelines.store.atomic import nearest_folder, probe_folder, too_long
from texloom.pipelines.store.folders import Folder, LinkError, is_link

FOLDERS = (
    "cache", "checkpoints", "records", "locks", "history", "log", "running", "sources", "exports", "runs",
    "written", "markers",
)  # fmt: skip
_MARKERS, _IDENTITY, _KEY_FILE, _README = "markers", "identity", "store.key", "README.md"
_TITLE = b"# The store\n"  # with which the README begins that the repository has in ``artifacts``
_RANDOM = re.compile(r"[0-9a-f]{32}")
_KEY = re.compile(rb"[0-9a-f]{64}")
_MOST = 4096  # bytes of a marker or key
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)


# -- the user's key


def _config_folder() -> Path:
    import platformdirs

    return platformdirs.user_config_path("texloom")


@functools.lru_cache
def _key_in(folder: Path) -> bytes:
    with Folder.at(folder) as opened:
        text = opened.read(_KEY_FILE, _MOST)
    if not _KEY.fullmatch(text):
        raise ValueError("not a key")
    return bytes.fromhex(text.decode())


def _key(create: bool = False) -> bytes | None:
    """This user's key, if there is one, or one can be made."""
    folder = _config_folder()
    with contextlib.suppress(OSError, ValueError):
        return _key_in(folder)
    if not create:
        return None
    with contextlib.suppress(OSError, ValueError), Folder.at(folder, create=True) as opened:
        opened.write_new(_KEY_FILE, secrets.token_hex(32).encode(), mode=0o600)
        return _key_in(folder)
    return None


def keeps_no_key() -> str | None:
    """Why this user can have no key, in a line; none if there is one, or one can be made."""
    if _key() is not None:
        return None
    folder = _config_folder()
    with contextlib.suppress(OSError):
        if not (folder / _KEY_FILE).exists():
            probe_folder(nearest_folder(folder))
            return None
    if _key() is not None:  # another process has made it meanwhile
        return None
    return f"no key can be kept in {folder}, so that nothing is removed from the store; set XDG_CONFIG_HOME"


def _key_id(key: bytes) -> str:
    return hashlib.sha256(b"texloom key " + key).hexdigest()[:16]


def _mac(key: bytes, *parts: str) -> str:
    return hmac.new(key, "\n".join(parts).encode(), hashlib.sha256).hexdigest()


# -- markers


def marked(root: Path) -> str | None:
    """The identity of a store that has this user's marker."""
    key = _key()
    if key is None:
        return None
    try:
        with Folder.at(root, _MARKERS) as folder:
            marker = json.loads(folder.read(_key_id(key), _MOST))
        identity, mac = marker["identity"], marker["hmac"]
        return str(identity) if hmac.compare_digest(mac, _mac(key, _IDENTITY, identity)) else None
    except _UNREADABLE:
        return None


def mark(root: Path) -> str:
    """Make a folder, which exists, a store of this user; its identity. The caller knows that it may."""
    with Folder.at(root) as folder:
        folder.write_new(_IDENTITY, secrets.token_hex(16).encode())
        identity = folder.read(_IDENTITY, _MOST).decode()
        if not _RANDOM.fullmatch(identity):
            raise refused(f"--store {root}: its file {_IDENTITY} was altered; remove that file")
        key = _key(create=True)
        if key is not None:
            marker = {"identity": identity, "hmac": _mac(key, _IDENTITY, identity)}
            with folder.child(_MARKERS, create=True) as markers:
                markers.write(_key_id(key), json.dumps(marker).encode(), durable=True)
    return identity


def signature(root: Path, text: str) -> str | None:
    """The HMAC of a setting of a store that has this user's marker."""
    identity, key = marked(root), _key()
    return None if identity is None or key is None else _mac(key, "setting", identity, text)


# -- what a folder is


def is_usable(root: Path) -> bool:
    """Whether a folder is a store of this user, or may become one as it is empty or absent."""
    if marked(root) is not None or _is_new(root):
        return True
    # a run that began meanwhile may have marked it
    return marked(root) is not None or (has_form(root) and (keeps_no_key() is not None or _is_in_cache(root)))


def _is_in_cache(root: Path) -> bool:
    """Whether a folder is in this user's cache folder for texloom, where nobody else can make one."""
    import platformdirs

    cache = platformdirs.user_cache_path("texloom")
    try:
        status = os.lstat(cache)
        is_private = os.name == "nt" or (status.st_uid == os.getuid() and not status.st_mode & 0o022)
        return is_private and stat.S_ISDIR(status.st_mode) and root.resolve().is_relative_to(cache.resolve())
    except OSError:
        return False


def check(root: Path) -> None:
    """`InputError` unless `is_usable`, or where one of its folders is a link."""
    problem = too_long(root)
    if problem is not None:
        raise refused(f"--store {os.fspath(root):.40}...: {problem}")
    try:
        refuse_links(root)
        if is_usable(root):
            return
    except (FileNotFoundError, NotADirectoryError):
        return  # whoever writes there says so
    except OSError as error:
        raise refused(f"--store {root}: cannot be read: {error.strerror}") from None
    if has_form(root):
        remedy = f"`texloom store adopt --store {shlex.quote(str(root))}` takes it over"
        raise refused(f"--store {root}: another user or machine made it; {remedy}")
    raise refused(f"--store {root}: holds files and is no store; give a new or an empty folder")


def refuse_links(root: Path) -> None:
    """`InputError` where one of a store's folders is a link."""
    with Folder.at(root) as folder:
        for name in FOLDERS:
            status = folder.status(name)
            if status is not None and is_link(status):
                error = LinkError(f"{root}/{name}")
                raise refused(f"--store {root}: {error.filename} {error.strerror}")


def has_form(root: Path) -> bool:
    """Whether a folder looks like a store, whoever made it."""
    try:
        with Folder.at(root) as folder:
            return any(_is_identity(folder, name) for name in folder.names()) or all(
                (status := folder.status(name)) is not None and stat.S_ISDIR(status.st_mode)
                for name in ("cache", "records")
            )
    except OSError:
        return False


def _is_new(root: Path) -> bool:
    """Whether nothing is there but what texloom writes first, and the README of the repository's ``artifacts``."""
    try:
        with Folder.at(root) as folder:
            return all(_is_first(folder, name) for name in folder.names())
    except FileNotFoundError:
        return True


def _is_first(folder: Folder, name: str) -> bool:
    try:
        if name == _README:
            return folder.read(name, 2**16).startswith(_TITLE)
        if name == _MARKERS:
            with folder.child(name) as markers:
                return all(other.startswith(".new-") for other in markers.names())
    except (OSError, ValueError):
        return False
    return name.startswith(".new-") or _is_identity(folder, name)


def _is_identity(folder: Folder, name: str) -> bool:
    try:
        return name == _IDENTITY and bool(_RANDOM.fullmatch(folder.read(name, _MOST).decode()))
    except (OSError, ValueError):
        return False
