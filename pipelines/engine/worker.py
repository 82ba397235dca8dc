"""What a process on this or another machine checks before it computes tasks for a run."""

from __future__ import annotations

import dataclasses
import socket
from pathlib import Path

from texloom.pipelines.store.atomic import probe_folder
from texloom.pipelines.store.store import Store, program_version
from texloom.stages.vocabulary.declare import InputError

PROBE = "probe"
"""the lock that a run holds while it asks workers whether it keeps them out"""


@dataclasses.dataclass(frozen=True)
class WorkerProbe:
    """A worker's answer to a run that wants to use it."""

    host: str
    problem: str = ""


def probe_worker(folder: str, identity: str, version: str) -> WorkerProbe:
    """Whether a worker can work for a run that holds the lock `PROBE` of the store."""
    import filelock

    host, store = socket.gethostname(), Store(Path(folder))
    try:
        ours = program_version()
        if ours != version:
            return WorkerProbe(host, f"it has {ours}, this is {version}")
        store.check_identity(identity)
        probe_folder(store.root)
        store.lock(PROBE, timeout=0).acquire().lock.release()
    except filelock.Timeout:
        return WorkerProbe(host)
    except (InputError, OSError) as error:
        return WorkerProbe(host, str(error))
    problem = f"it can take a lock in {folder} that is held here: the file system must support flock"
    return WorkerProbe(host, problem)
