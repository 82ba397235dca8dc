"""Example-based texture synthesis: published methods as cached stages, joined by flows."""

# ruff: noqa: PTH100, PTH112, PTH120
# Neither `pathlib` nor `typing` is imported: the command handles signals only after this module.

import os

TYPE_CHECKING = False

if TYPE_CHECKING:
    from texloom import stages as stages
    from texloom.pipelines.api import plan as plan
    from texloom.pipelines.api import run as run
    from texloom.pipelines.api import synthesize as synthesize
    from texloom.pipelines.engine.run import StepFailedError as StepFailedError
    from texloom.pipelines.media.deep_zoom import write_deep_zoom as write_deep_zoom
    from texloom.stages.analysis.photographs.jacobian_field import control_points as control_points
    from texloom.stages.interactive.canvas import Canvas as Canvas
    from texloom.stages.interactive.lattice_session import LatticeSession as LatticeSession
    from texloom.stages.interactive.photo_session import PhotoSession as PhotoSession
    from texloom.stages.vocabulary.arrays import Image as Image
    from texloom.stages.vocabulary.declare import InputError as InputError

    __version__: str

# A clone without symbolic links has text files in place of the links to the repository's folders.
_HERE = os.path.dirname(os.path.abspath(__file__))
if not os.path.isdir(f"{_HERE}/stages"):
    _CLONE = os.path.dirname(os.path.dirname(_HERE))
    if not os.path.isdir(f"{_CLONE}/stages"):
        raise ImportError("texloom was packed without symbolic links; install such a clone by `pip install -e .`")
    __path__.append(_CLONE)

# Each is imported when it is first used.
_PUBLIC = {
    "Canvas": "texloom.stages.interactive.canvas",
    "Image": "texloom.stages.vocabulary.arrays",
    "InputError": "texloom.stages.vocabulary.declare",
    "LatticeSession": "texloom.stages.interactive.lattice_session",
    "PhotoSession": "texloom.stages.interactive.photo_session",
    "StepFailedError": "texloom.pipelines.engine.run",
    "control_points": "texloom.stages.analysis.photographs.jacobian_field",
    "plan": "texloom.pipelines.api",
    "run": "texloom.pipelines.api",
    "stages": "",
    "synthesize": "texloom.pipelines.api",
    "write_deep_zoom": "texloom.pipelines.media.deep_zoom",
}
__all__ = [
    "Canvas", "Image", "InputError", "LatticeSession", "PhotoSession", "StepFailedError", "control_points", "plan",
    "run", "stages", "synthesize", "write_deep_zoom",
]  # fmt: skip

if not TYPE_CHECKING:

    def __getattr__(name):
        if name == "__version__":
            from importlib.metadata import version

            return version("texloom")
        if name not in _PUBLIC:
            raise AttributeError(f"module 'texloom' has no attribute '{name}'")
        from importlib import import_module

        if name == "stages":
            return import_module("texloom.stages")
        value = globals()[name] = getattr(import_module(_PUBLIC[name]), name)
        return value

    def __dir__():
        return sorted({*globals(), *_PUBLIC, "__version__"})
