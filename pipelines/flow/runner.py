"""The runner, from ``runner`` of a flow and the options of the command line."""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Callable, Mapping
from typing import Any

from texloom.pipelines.errors import hint, one_of, refused, shown
from texloom.pipelines.flow.model import RUNNERS, WITH_WORKERS, Runner
from texloom.stages.vocabulary.declare import InputError

_FIELDS = ("name", "workers", "address")
_MAX_WORKERS = 1024
_NUMBA = ".numba_config.yaml"  # settings that it takes from the working folder, whoever wrote them
_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx)://[^\s/]+:\d{1,5}")

Fail = Callable[[str, str], InputError]


def choose_runner(declared: Any, overrides: Mapping[str, Any], fail: Fail) -> Runner:
    """The runner of a flow; the local one where none is specified.

    Parameters
    ----------
    declared : of the flow: a name, or a mapping with ``name``, ``workers`` and ``address``.
    overrides : the fields on the command line; another name there discards those of the flow.
    fail : makes the error of a place in the flow and a problem.
    """
    fields = _fields(declared, fail)
    _check(fields, lambda field, problem: fail(f"runner.{field}", problem))
    if "name" in overrides and overrides["name"] != fields.get("name"):
        fields = {}
    if overrides:
        fields = {**fields, **overrides}
        _check(fields, lambda field, problem: refused(f"--{'runner' if field == 'name' else field}: {problem}"))
    return Runner(**fields) if fields else Runner("local")


def require_installed(runner: Runner) -> None:
    """`InputError` where what the runner needs is missing; nothing is imported."""
    if runner.name == "dask" and importlib.util.find_spec("distributed") is None:
        raise InputError("--runner dask: Dask is not installed; pip install 'texloom[dask]'")


def check_environment() -> None:
    """`InputError` where an environment variable or a file that says how to compute is wrong."""
    from texloom.stages.kernels.core.threads import thread_count

    try:
        thread_count()
    except ValueError as error:
        raise refused(str(error)) from None
    if os.environ.get("TEXLOOM_DEVICE"):
        from texloom.stages.common.per_pixel.device import wanted_device

        wanted_device()
    if os.path.lexists(_NUMBA):
        raise refused(f"{_NUMBA}: Numba would obey this file; remove it, or work in another folder")


def _fields(declared: Any, fail: Fail) -> dict[str, Any]:
    if declared is None:
        return {}
    if isinstance(declared, str):
        return {"name": declared}
    if not isinstance(declared, dict):
        raise fail("runner", f"must be a name or a mapping with 'name' and 'workers', got {shown(declared)}")
    for key in declared:
        if key not in _FIELDS:
            raise fail(f"runner.{key}", f"unknown{hint(str(key), _FIELDS)}")
    return {"name": None, **declared}


def _check(fields: Mapping[str, Any], fail: Fail) -> None:
    """Raise where a field is wrong or the fields contradict each other."""
    if not fields:
        return
    name, workers, address = (fields.get(field) for field in _FIELDS)
    if name is None:
        field, needed = ("address", ("dask",)) if address is not None else ("workers", WITH_WORKERS)
        if fields.get(field) is None:
            raise fail("name", f"missing{one_of(RUNNERS)}")
        raise fail(field, f"needs a runner that has it: {', '.join(needed)}")
    if not isinstance(name, str) or name not in RUNNERS:
        raise fail("name", f"no runner {shown(name)}{hint(str(name), RUNNERS)}")
    if workers is not None:
        if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= _MAX_WORKERS:
            raise fail("workers", f"must be a whole number from 1 to {_MAX_WORKERS}, got {shown(workers)}")
        if name not in WITH_WORKERS:
            raise fail("workers", f"the runner '{name}' has none; {', '.join(WITH_WORKERS)} have")
    if address is not None:
        if name != "dask":
            raise fail("address", f"the runner '{name}' has none; it is for 'dask'")
        if not isinstance(address, str) or not _ADDRESS.fullmatch(address):
            raise fail("address", f"must be like 'tcp://head:8786', got {shown(address)}")
        if workers is not None:
            raise fail("workers", "a running cluster has its own workers; leave it out")
