"""What texloom runs on: versions, processors, caches, store, GPU, server."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any, TextIO
from urllib.error import URLError

import texloom
from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.errors import one_line

_LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "OpenEXR", "prefect")
_WARMED = (
    "self_tuning", "materials", "make_tileable", "quilting", "graph_cut", "patch_based", "hybrid", "adaptive",
    "near_regular", "per_pixel", "inverse", "bidirectional_similarity",
    "image_melding",
)  # fmt: skip
_DISTRIBUTION = "opencv-contrib-python-headless"
_OPENCV = (4, 10)  # the oldest that is tried
_SIDE = 96  # px of what is made
_LITTLE = 1e9  # bytes of free space


def examine(store: Path) -> dict[str, Any]:
    """The state of the installation, ready for JSON."""
    from texloom.pipelines.media.formats import readable
    from texloom.pipelines.memory import memory_limit

    return {
        "texloom": {"version": texloom.__version__, "folder": str(Path(__file__).parents[2])},
        "python": {"version": platform.python_version(), "program": sys.executable, "system": platform.platform()},
        "libraries": {name: importlib.metadata.version(name) for name in _LIBRARIES},
        "opencv": _opencv(),
        "formats": {name: {"missing": needs or None} for name, needs in readable().items()},
        "processors": _processors(),
        "memory": {"pictures": memory_limit()},
        "kernels": _kernels(),
        "store": _store(store),
        "gpu": _gpu(),
        "prefect": _prefect(),
    }


def warm(out: TextIO) -> None:
    """Compile the kernels of the common flows, by running each on a small exemplar in a store that is removed."""
    from texloom.pipelines import api

    with tempfile.TemporaryDirectory() as folder:
        for flow in _WARMED:
            began = time.perf_counter()
            flow_params = {} if flow == "make_tileable" else {"size": _SIDE}
            api.run(flow, _small_sources(flow), flow_params, store=folder, out=Path(folder) / "out" / flow)
            print(f"{flow:20}  {time.perf_counter() - began:.1f} s", file=out, flush=True)


def _small_sources(flow: str) -> dict[str, Any]:
    """A part of the example that ships, of a few bricks; without an own example where one is small already."""
    from texloom.pipelines.flow.loader import find_flow, load_flow
    from texloom.pipelines.media.sources import open_source

    if flow in ("materials", "near_regular"):
        return {}
    exemplar = open_source("exemplar", "texloom:bricks").read().pixels[:192, :192]
    return dict.fromkeys(load_flow(find_flow(flow)).sources, exemplar)


def described(found: dict[str, Any]) -> str:
    """The state on one screen."""
    python, processors, kernels = found["python"], found["processors"], found["kernels"]
    store, prefect = found["store"], found["prefect"]
    compiled = f"{kernels['compiled']} compiled, {format_byte_size(kernels['bytes'])}"
    if not kernels["compiled"]:
        compiled = "none compiled yet; the first run of a method does it, or texloom doctor --warm"
    libraries = ", ".join(f"{name} {version}" for name, version in found["libraries"].items())
    opencv = found["opencv"]
    installed = ", ".join(f"{name} {version}" for name, version in opencv["installed"].items())
    lines = {
        "texloom": f"{found['texloom']['version']}  {found['texloom']['folder']}",
        "python": f"{python['version']}  {python['program']}  {python['system']}",
        "libraries": libraries,
        "opencv": f"{opencv['version'] or 'not usable'}  {opencv['file'] or ''}, of {installed}",
        "pictures": _formats(found["formats"]),
        "processors": f"{processors['usable']} of {processors['all']}; {processors['threads']} threads",
        "memory": f"{format_byte_size(found['memory']['pictures'])} for the pictures of a run",
        "kernels": f"{compiled}  {kernels['folder']}",
        "store": f"{store['state']}, {format_byte_size(store['free'])} free  {store['folder']}",
        "gpu": found["gpu"]["problem"] or "usable; TEXLOOM_DEVICE=gpu chooses it",
        "prefect": f"{prefect['url']} {prefect['problem'] or 'answers'}" if prefect["url"] else "not used",
    }
    warnings = [f"warning: {text}" for text in _warnings(found)]
    return "\n".join([*(f"{name:10}  {text}" for name, text in lines.items()), *warnings])


def _formats(found: dict[str, Any]) -> str:
    """The formats of pictures that are read, and those that need more libraries."""
    without = [f"{name} needs {one['missing']}" for name, one in found.items() if one["missing"]]
    remedy = f"; {', '.join(without)}: pip install 'texloom[photos]'" if without else ""
    return ", ".join(name for name, one in found.items() if not one["missing"]) + remedy


def _opencv() -> dict[str, Any]:
    """The OpenCV that is imported, which another distribution may have put there, or taken away."""
    names = ((str(one.name).lower().replace("_", "-"), one.version) for one in importlib.metadata.distributions())
    installed = dict(sorted((name, version) for name, version in names if name.startswith("opencv-")))
    try:
        import cv2

        version, file = str(cv2.__version__), str(cv2.__file__)
    except (ImportError, AttributeError) as error:  # of its folder nothing but links or caches may be left
        problem = (
            f"OpenCV is not whole ({one_line(str(error))}), as where another distribution of it was removed: "
            f"pip install --force-reinstall --no-deps {' '.join(installed) or _DISTRIBUTION}"
        )
        return {"version": None, "file": None, "installed": installed, "problem": problem}
    oldest = ".".join(map(str, _OPENCV))
    remedy = f"OpenCV {version} is older than {oldest}: pip install '{_DISTRIBUTION}>={oldest}'"
    is_old = tuple(int(number) for number in version.split(".")[:2]) < _OPENCV
    return {"version": version, "file": file, "installed": installed, "problem": remedy if is_old else ""}


def _processors() -> dict[str, Any]:
    from texloom.stages.kernels.core.threads import processors, thread_count

    return {"usable": processors(), "all": os.cpu_count(), "threads": thread_count()}


def _kernels() -> dict[str, Any]:
    from texloom.stages.kernels.core.kernel_folder import kernel_folder

    folder = kernel_folder()
    files = [path for path in folder.rglob("*.nb?") if path.is_file()]
    compiled = {path.name for path in files if path.suffix == ".nbi"}
    return {"folder": str(folder), "compiled": len(compiled), "bytes": sum(path.stat().st_size for path in files)}


def _store(folder: Path) -> dict[str, Any]:
    from texloom.pipelines.store.store import Store
    from texloom.stages.vocabulary.declare import InputError

    opened = Store(folder)
    there = next(path for path in (opened.root, *opened.root.parents) if path.exists())
    try:
        opened.check_owned()
        opened.check_writable()
        state = "writable" if opened.root.exists() else "not there yet"
    except InputError as error:
        state = str(error)
    return {"folder": str(opened.root), "state": state, "free": shutil.disk_usage(there).free}


def _gpu() -> dict[str, str]:
    from texloom.stages.common.per_pixel.device import gpu_problem

    return {"problem": gpu_problem()}


def _prefect() -> dict[str, str | None]:
    url = os.environ.get("PREFECT_API_URL")
    if not url:
        return {"url": None, "problem": None}
    try:
        with urllib.request.urlopen(f"{url.rstrip('/')}/health", timeout=2):  # noqa: S310 (the user's own server)
            return {"url": url, "problem": None}
    except (URLError, OSError, ValueError) as error:
        return {"url": url, "problem": f"does not answer: {error}"}


def _warnings(found: dict[str, Any]) -> list[str]:
    store, opencv = found["store"], found["opencv"]
    little = f"little free space for the store {store['folder']}" if store["free"] < _LITTLE else ""
    return [warning for warning in (opencv["problem"], little) if warning]
