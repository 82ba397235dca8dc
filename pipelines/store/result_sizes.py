"""An index of how many bytes each result takes, so that not every listing has to look at all files of a million.

``result_sizes`` in the store has the SHA-256 of what follows, a line end, a 64-bit number for each result that
tells it, and another for each that is its size. The first is made of the beginning of its key and the inode of its
folder, which listing the folder above tells: a result that was computed again, copied or restored is in another
folder, and is measured again. So nobody has to tell the index what was written or removed. Whoever lists the store
writes it, whole or not at all, once many results are new or gone; where it is missing, broken, old, or cannot be
written, sizes are measured. Of two processes at once one is not heard.

It only spares measuring. Which results there are, and when they were used, is read from the store itself; before
anything is removed to keep a limit, all is measured. A result that was altered by hand keeps its size here:
`texloom store verify` finds it.
"""

from __future__ import annotations

import array
import contextlib
import hashlib
from collections.abc import Mapping

from texloom.pipelines.store import ownership
from texloom.pipelines.store.store import Store

Sizes = Mapping[int, int]
"""`token` to bytes"""
NAME = "result_sizes"
UNKNOWN = (0, 2**32 - 1)
"""inodes of file systems that tell none, of which nothing is noted"""
_MOST = 2**28  # bytes: 16 million results
_NUMBERS = 2**64 - 1
_FEW = 1000  # to measure so many takes as long as to write the sizes of 100,000


def token(key: str, inode: int) -> int:
    """What tells a result and its folder from all others."""
    return int(key[:16], 16) ^ inode & _NUMBERS  # Windows has larger ones


def read(store: Store) -> Sizes:
    """What is known; nothing where there is no index, or it is not as it was written."""
    with contextlib.suppress(OSError, ValueError), store.inside() as folder:
        digest, _, content = folder.read(NAME, _MOST).partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() == digest and len(content) % 16 == 0:
            numbers = array.array("Q", content)
            half = len(numbers) // 2
            return dict(zip(numbers[:half], numbers[half:], strict=True))
    return {}


def keep(store: Store, known: Sizes, found: Sizes) -> None:
    """Write what was ``found`` if much of it was not ``known``, or is gone, and the store is this user's."""
    new = sum(one not in known for one in found)
    gone = len(known) - (len(found) - new)
    if new + gone <= _FEW + len(found) // 100 or ownership.marked(store.root) is None:
        return
    numbers = array.array("Q", found)
    numbers.extend(found.values())
    content = numbers.tobytes()
    with contextlib.suppress(OSError), store.inside() as folder:
        folder.write(NAME, hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
