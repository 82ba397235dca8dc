"""What runs return to Python: the outputs of steps, read when they are asked for, and textures."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from texloom.pipelines.errors import one_line, one_of
from texloom.pipelines.flow.model import Flow, Reference
from texloom.pipelines.media.array_sources import Picture, kinds_of
from texloom.pipelines.media.material_export import channels_of, codes_of, write_maps
from texloom.pipelines.media.sources import Source
from texloom.pipelines.media.writers.writer_registry import WRITERS, WriteJob, write, writer_of
from texloom.pipelines.store.atomic import write_atomically
from texloom.pipelines.store.png_file import png, with_facts
from texloom.pipelines.store.store import Artifact, Store
from texloom.pipelines.store.types import Hint
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size

if TYPE_CHECKING:
    from texloom.pipelines.engine.events import Recorder, StepReport
    from texloom.pipelines.engine.run import Run


class StepResult:
    """The outputs of a step as attributes; each is read from the store when it is first asked for."""

    def __init__(self, store: Store, artifact: Artifact, kind: type[Any]):
        self._store, self._artifact, self._kind = store, artifact, kind

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # Python and its tools look for such names
            raise AttributeError(name)
        if name not in self._artifact.outputs:
            outputs = ", ".join(self._artifact.outputs)
            raise AttributeError(f"stage {self._artifact.stage} has no output '{name}'; it has {outputs}")
        value = self._store.load(self._artifact, self._kind, [name])[name]
        setattr(self, name, value)
        return value

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._artifact.outputs]

    @property
    def folder(self) -> Path:
        """Where the result lies in the store."""
        return self._artifact.folder

    def __repr__(self) -> str:
        return f"<{self._artifact.stage}: {', '.join(self._artifact.outputs)}>"


class Result:
    """What a run has made: ``result["texture"].image``, over a set ``result["item/texture"].image``.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> done = texloom.run("quilting", {"exemplar": skimage.data.brick()[:48, :48]}, size=64, seeds=2)
    >>> done.items
    ['7', '8']
    >>> done["7/texture"].image.shape
    (64, 64, 1)
    """

    def __init__(self, opened: Run, exports: Mapping[str, Path], recorder: Recorder):
        self._opened = opened
        self.exports: dict[str, Path] = dict(exports)
        """name to file; over a set ``item/name``"""
        self.reports: list[StepReport] = list(recorder.reports.values())
        """for every step whether it was cached, ran or failed, and how long it took"""
        self.problems: dict[str, str] = recorder.problems
        """the items that failed, and why"""
        self.shared: dict[str, int] = recorder.shared
        """how many results were ``fetched`` from the shared store, ``uploaded``, or have ``failed`` to be"""

    @property
    def items(self) -> list[str]:
        """The items of a set; empty for a flow over single sources."""
        return [item.name for item in self._opened.items]

    @property
    def steps(self) -> list[str]:
        """The names that `__getitem__` takes."""
        return list(self._artifacts())

    def _artifacts(self) -> dict[str, Artifact]:
        scopes = [self._opened.shared, *self._opened.scopes.values()]
        return {
            step if scope.item is None else f"{scope.item.name}/{step}": artifact
            for scope in scopes
            if scope is not None
            for step, artifact in scope.artifacts.items()
        }

    def __getitem__(self, step: str) -> StepResult:
        artifacts = self._artifacts()
        if step not in artifacts:
            item = step.rpartition("/")[0]
            hint = f": {self.problems[item]}" if item in self.problems else one_of(artifacts)
            raise KeyError(one_line(f"no result of '{step}'{hint}"))
        kind = self._opened.flow.steps[step.rpartition("/")[2]].stage.result
        return StepResult(self._opened.store, artifacts[step], kind)

    def __contains__(self, step: object) -> bool:
        return step in self._artifacts()

    def __iter__(self) -> Iterator[str]:
        return iter(self._artifacts())

    def __len__(self) -> int:
        return len(self._artifacts())

    def __repr__(self) -> str:
        return f"<{self._opened.flow.name}: {', '.join(self.steps)}>"


class Texture:
    """A synthesised texture."""

    def __init__(self, result: Result, image: Reference, source: Source, given: Picture, method: str):
        self.result = result
        """the results of all steps"""
        self._source, self._given, self._method = source, given, method
        self._flow = result._opened.flow
        self._texture = result[image.name]
        self._linear: Image = getattr(self._texture, image.output or "")
        self._kinds = kinds_of(source, given)

    @property
    def image(self) -> np.ndarray:
        """The texture's colour as an array of the exemplar's kind: grey or colour, its dtype, sRGB or linear."""
        return self.maps["albedo"] if "albedo" in self.maps else next(iter(self.maps.values()))

    @property
    def maps(self) -> dict[str, np.ndarray]:
        """All maps by the names that they were given by, each of its own kind; ``albedo`` alone for one picture."""
        if not hasattr(self, "_maps"):
            known = self._linear.channels  # of several exemplars, those that all have
            kinds = [kind for kind in self._kinds if channels_of(kind.role, known)]
            self._maps = {kind.name: kind.array(self._linear) for kind in kinds}
        return self._maps

    @property
    def linear(self) -> Image:
        """All channels as the method made them: linear light, float32."""
        return self._linear

    @property
    def source_map(self) -> np.ndarray | None:
        """For every pixel the row and column of the exemplar's pixel that it comes from, uint32 (h, w, 2)."""
        made = [self._texture, *([self.result["texture"]] if "texture" in self.result else [])]
        return next((step.match for step in made if hasattr(step, "match")), None)

    @property
    def scores(self) -> dict[str, Any]:
        """How good the texture is, see ``texloom stages evaluation.metrics``; empty where the method has none."""
        from texloom.pipelines.engine.run_scores import scores

        return scores(self.result._opened)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the texture.

        Parameters
        ----------
        path : the extension decides: ``.exr`` holds all channels in linear light without loss; ``.png`` the colour,
            in 8 bits if the exemplar had them, else in 16; ``.jpg``, ``.webp``, ``.tif``, ``.tx``, ``.mtlx``,
            ``.usda`` and ``.glb`` are as of ``texloom run``. Without an extension it is a folder: a PNG for each
            map, ``material.exr`` and a MaterialX document.

        Raises
        ------
        InputError
            there is no writer for the extension.

        Examples
        --------
        >>> import skimage.data, texloom
        >>> made = texloom.synthesize(skimage.data.brick()[:48, :48], size=64, method="quilting")
        >>> made.save("brick.exr"), made.save("brick").is_dir()
        (PosixPath('brick.exr'), True)
        """
        target = Path(path).expanduser()
        provenance = {"flow": self._flow.name, "seed": self._flow.seeds[0], "output": "texture.image"}
        is_folder = target.is_dir() or not target.suffix
        writer = None if is_folder else writer_of(target.name)
        if not is_folder and (writer is None or writer.takes not in ("array", "picture", "image")):
            kinds = ", ".join(one.suffix for one in WRITERS if one.takes in ("array", "picture", "image"))
            raise InputError(f"{target}: no writer for '{target.suffix}'; {kinds} and a folder can be written")
        target.parent.mkdir(parents=True, exist_ok=True)
        if is_folder:
            write_maps(self._linear, target, self._source.maps, provenance, fed=self._source.map_bits)
        elif target.suffix != ".png":
            write(WriteJob(target, self._linear, Image, provenance, bits=self._source.map_bits))
        else:
            names = channels_of("albedo", self._linear.channels)
            names = ["Y", *names[3:]] if names[0] == "Y" else names
            bits = 8 if self.image.dtype == np.uint8 else 16
            explained = with_facts(provenance, self._linear.facts, self._linear.height, self._linear.width)
            write_atomically(target, png(codes_of(self._linear, names, "albedo", bits, False), explained))
        return target

    def _repr_png_(self) -> bytes:
        return png(self._linear.srgb)

    def _repr_html_(self) -> str:
        title = f"{format_size(self._linear)}, {self._method}, seed {self._flow.seeds[0]}"
        content = base64.b64encode(self._repr_png_()).decode()
        return (
            f'<figure style="margin:0"><img style="max-width:100%" src="data:image/png;base64,{content}">'
            f"<figcaption>{html.escape(title)}</figcaption></figure>"
        )

    def __repr__(self) -> str:
        maps = ", ".join(self.maps)
        return f"<Texture {format_size(self._linear)}, {maps}, by {self._method}>"


def main_image(flow: Flow, method: str | os.PathLike[str]) -> Reference:
    """The image that a flow is about: what it exports as ``texture.*``, else the first image that it exports."""
    for _, reference in sorted(flow.exports.items(), key=lambda export: not export[0].startswith("texture.")):
        step = flow.steps.get(reference.name)
        if step is not None and Hint.of(step.stage.outputs.get(reference.output or "")).plain is Image:
            return reference
    raise InputError(f"method '{method}' makes no picture; use texloom.run")


def main_result(
    result: Result, given: Mapping[str, Picture | Sequence[Picture]]
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """The maps of the image that a run is about, each as the source that it is like was given, and its scores.

    Nothing of flows that make an image for each item of a set; no maps of those that make no picture.
    """
    from texloom.pipelines.engine.run_scores import main_scores

    opened = result._opened
    flow = opened.flow
    try:
        image = main_image(flow, flow.name)
    except InputError:
        return {}, main_scores(opened)
    if opened.scope_of(image) == "item" or image.name not in result:
        return {}, {}
    likes = [like for export, like in flow.likes.items() if flow.exports[export] == image]
    name = next(iter([*likes, *flow.sources]))
    sources = [scope.source(name) for scope in opened.known_scopes if scope.has_source(name)]
    source = max(sources, key=lambda one: max(one.map_bits.values(), default=0))  # of a set, the one with most bits
    like: Any = given.get(name, source.reference)
    like = source.reference if isinstance(like, list | tuple) else like
    return Texture(result, image, source, like, flow.name).maps, main_scores(opened)


def scores_of(flow: Flow) -> Reference | None:
    """The table of a flow's scores, where it has one."""
    steps = [step.name for step in flow.steps.values() if step.stage.role == "scores"]
    return Reference(steps[0], "table") if steps else None
