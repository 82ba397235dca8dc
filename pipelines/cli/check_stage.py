"""Property tests of a stage, as of a plug-in: documentation, equal bits, masks, tiling, maps, bad input."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np

from texloom.pipelines.cli.describe import description
from texloom.pipelines.store import codec
from texloom.pipelines.store.types import Hint
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.checkpoints import NoCheckpoints
from texloom.stages.vocabulary.declare import InputError, Stage
from texloom.stages.vocabulary.normals import NORMAL

State = Literal["passed", "failed", "skipped"]
_THREADS = "TEXLOOM_THREADS"
_SIDE = 48  # px of the exemplar
_SIZE = (40, 56)  # px of results, where a stage has a size
_SEAM = 2.0  # largest ratio of the differences across a seam and inside


@dataclasses.dataclass(frozen=True)
class Check:
    """What has become of one property."""

    name: str
    state: State
    detail: str = ""


class _SkipError(Exception):
    """A property does not apply to the stage."""


class _FailError(Exception):
    """A property does not hold."""


def check_stage(name: str) -> list[Check]:
    """Check the stage called ``name``; `InputError` if there is none, or it cannot be imported.

    The inputs are a small synthetic material, or arrays of its size; stages that need others are checked as far as
    that goes.
    """
    found = description(name)
    subject = _Subject(find_stage(found["name"]))
    checks: dict[str, Callable[[], str]] = {
        "documentation": lambda: _documented(found),
        "result": subject.result,
        "same bits": subject.same_bits,
        "seed": subject.seeds,
        "inputs unchanged": subject.inputs_unchanged,
        "masks": subject.masks,
        "tiling": subject.tiling,
        "maps": subject.maps,
        "bad input": subject.bad_input,
    }
    return [_outcome(label, check) for label, check in checks.items()]


def _outcome(label: str, check: Callable[[], str]) -> Check:
    try:
        return Check(label, "passed", check())
    except _SkipError as reason:
        return Check(label, "skipped", str(reason))
    except (Exception, SystemExit) as error:  # a stage under test may raise anything
        detail = str(error) if isinstance(error, _FailError) else f"{type(error).__name__}: {error}"
        return Check(label, "failed", " ".join(detail.split()))


def _documented(found: Mapping[str, Any]) -> str:
    lacking = [] if found["summary"] else ["a first line of the docstring"]
    lacking += [
        f"{kind}.{key}"
        for kind in ("inputs", "params", "outputs")
        for key, what in found[kind].items()
        if not what["what"]
    ]
    if lacking:
        raise _FailError(f"not documented: {', '.join(lacking)}")
    return ""


def exemplar(side: int = _SIDE, seed: int = 1, alpha: bool = False) -> Image:
    """A tiled pattern with noise, as a material: colour, normals, roughness, height."""
    rng = np.random.default_rng(seed)
    row, column = np.indices((side, side))
    shade = (((row // 8 + column // 8) % 2) * 0.5 + 0.25)[..., None].astype(np.float32)
    color = shade * np.array([1, 0.8, 0.6], np.float32) + rng.uniform(0, 0.1, (side, side, 3)).astype(np.float32)
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), (side, side, 3))
    more = rng.uniform(0, 1, (side, side, 2)).astype(np.float32)
    names: tuple[str, ...] = ("R", "G", "B", *NORMAL, "roughness", "height")
    pixels = np.concatenate([color, normals, more], axis=2)
    if alpha:
        opaque = np.ones((side, side, 1), np.float32)
        opaque[: side // 3, : side // 3] = 0
        pixels = np.concatenate([pixels[..., :3], opaque, pixels[..., 3:]], axis=2)
        names = ("R", "G", "B", "A", *names[3:])
    return Image(np.ascontiguousarray(pixels), names)


class _Subject:
    """A stage and what it makes of synthetic inputs."""

    def __init__(self, stage: Stage):
        self.stage = stage
        self._plain: Any = None

    def run(self, image: Image, seed: int = 1, **params: Any) -> Any:
        """The stage's result."""
        values: dict[str, Any] = {name: self._given(name, image) for name in self._needed()}
        names = self.stage.function.__annotations__
        if "params" in names:
            fields = self.stage.params.model_fields
            values["params"] = self.stage.params(**({"size": _SIZE} if "size" in fields else {}), **params)
        if self.stage.uses_rng:
            values["rng"] = np.random.default_rng(seed)
        if self.stage.uses_checkpoints:
            values["checkpoints"] = NoCheckpoints()
        return self.stage.function(**values)

    def plain(self) -> Any:
        """The result of the exemplar, computed once."""
        if self._plain is None:
            self._plain = self.run(exemplar())
        return self._plain

    def _needed(self) -> list[str]:
        if self.stage.uses_items or self.stage.uses_provenance:
            raise _SkipError("the stage gathers items or provenance")
        return [name for name in self.stage.inputs if name not in self.stage.optional]

    def _given(self, name: str, image: Image) -> Any:
        hint = Hint.of(self.stage.inputs[name])
        if hint.plain is Image:
            return image
        axes = len(hint.plain.dim_str.split()) if hint.is_array else 0
        if axes == 2 and hint.plain.dtypes[0] == "bool":
            return image.color.mean(axis=2) > 0.5
        if axes == 2 and "float32" in hint.plain.dtypes:
            return np.ascontiguousarray(image.color.mean(axis=2))
        raise _SkipError(f"its input '{name}' ({hint}) cannot be made up")

    def _has_param(self, name: str) -> bool:
        return name in self.stage.params.model_fields

    def result(self) -> str:
        """Whether outputs have the declared types."""
        return ", ".join(codec.digests(self.plain()))

    def same_bits(self) -> str:
        """Whether the result is repeatable on any number of threads."""
        expected = codec.digests(self.plain())
        for count in (1, 3):
            with _threads(count):
                found = codec.digests(self.run(exemplar()))
            if found != expected:
                names = [name for name in expected if found[name] != expected[name]]
                raise _FailError(f"{', '.join(names)} differ in another run on {count} threads")
        return "1 and 3 threads"

    def seeds(self) -> str:
        """Whether the seed counts."""
        if not self.stage.uses_rng:
            raise _SkipError("the stage draws no random numbers")
        if codec.digests(self.run(exemplar(), seed=2)) == codec.digests(self.plain()):
            raise _FailError("another seed gives the same result")
        return ""

    def inputs_unchanged(self) -> str:
        """Whether inputs are left as they are."""
        image = exemplar()
        self.run(image)
        if not np.array_equal(image.pixels, exemplar().pixels):
            raise _FailError("the stage changes its input")
        return ""

    def masks(self) -> str:
        """Whether excluded pixels are never copied."""
        match = self._match()
        image = exemplar(alpha=True)
        made = self.run(image)
        row, column = np.moveaxis(getattr(made, match).astype(int), -1, 0)
        excluded = image.pixels[row, column, image.channels.index("A")] < 0.5
        if excluded.any():
            raise _FailError(f"{int(excluded.sum())} of {excluded.size} pixels are copies of transparent ones")
        return ""

    def _match(self) -> str:
        """The output that tells where pixels come from."""
        self._image_input()
        if "match" not in self.stage.outputs:
            raise _SkipError("no output 'match' tells where pixels come from")
        return "match"

    def _image_input(self) -> None:
        if not any(Hint.of(hint).plain is Image for hint in self.stage.inputs.values()):
            raise _SkipError("the stage takes no image")

    def _image_output(self) -> str:
        names = [name for name, hint in self.stage.outputs.items() if Hint.of(hint).plain is Image]
        if not names:
            raise _SkipError("the stage makes no image")
        return names[0]

    def tiling(self) -> str:
        """Whether opposite borders fit, and the result says so."""
        if not self._has_param("tileable"):
            raise _SkipError("the stage has no param 'tileable'")
        name = self._image_output()
        made = getattr(self.run(exemplar(), tileable=True), name)
        pixels = made.pixels[..., :3].astype(np.float64)
        ratios = []
        for axis in (0, 1):
            inside = np.abs(np.diff(pixels, axis=axis)).mean()
            across = np.abs(pixels.take(0, axis=axis) - pixels.take(-1, axis=axis)).mean()
            ratios.append(across / max(inside, 1e-9))
        if max(ratios) > _SEAM:
            raise _FailError(f"differences across the borders are {max(ratios):.1f} times those inside")
        if not made.wraps.both:
            raise _FailError("the result does not say that it wraps; return image.wrapping(params.tileable)")
        return f"{max(ratios):.2f} times the differences inside"

    def maps(self) -> str:
        """Whether all maps come from one correspondence."""
        self._image_input()
        name = self._image_output()
        image, made = exemplar(), self.plain()
        result = getattr(made, name)
        if result.channels != image.channels:
            raise _FailError(f"the result has the channels {', '.join(result.channels)}, not those of the exemplar")
        if not np.isfinite(result.pixels).all():
            raise _FailError("the result has values that are NaN or infinite")
        if "match" not in self.stage.outputs:
            return "channels"
        row, column = np.moveaxis(made.match.astype(int), -1, 0)
        same = np.abs(result.pixels - image.pixels[row, column]) < 1e-5
        copied = same[..., :3].all(axis=2)
        if copied.any() and not same[copied].all():
            raise _FailError("where colour is copied, other maps come from elsewhere")
        return f"{copied.mean():.0%} of the pixels are copies"

    def bad_input(self) -> str:
        """Whether odd pictures are accepted or refused by an `InputError`."""
        self._image_input()
        grey = exemplar()
        flat = Image(np.full((_SIDE, _SIDE, 3), 0.5, np.float32), ("R", "G", "B"))
        cases = {
            "2 x 2 px": exemplar(2),
            "one row": Image(grey.pixels[:1].copy(), grey.channels),
            "a constant picture": flat,
            "a grey picture": Image(grey.pixels[..., :1].copy(), ("Y",)),
            "bright light": Image(flat.pixels * np.float32(1e4), flat.channels),
            "no light": Image(flat.pixels * 0, flat.channels),
        }
        for label, image in cases.items():
            try:
                codec.digests(self.run(image))
            except InputError as error:
                if len(str(error).splitlines()) != 1:
                    raise _FailError(f"{label}: the message of InputError is not one line") from None
            except _SkipError:
                raise
            except (Exception, SystemExit) as error:
                raise _FailError(f"{label}: {type(error).__name__}: {error}; expected InputError") from None
        return f"{len(cases)} odd pictures"


@contextmanager
def _threads(count: int) -> Iterator[None]:
    before = os.environ.get(_THREADS)
    os.environ[_THREADS] = str(count)
    try:
        yield
    finally:
        os.environ.pop(_THREADS)
        if before is not None:
            os.environ[_THREADS] = before
