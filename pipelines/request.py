"""A request for a run, however it is made: on the command line, in Python, by Prefect, in the studio."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import pydantic

from texloom.pipelines.errors import refused, shown
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.request_fields import DELIVERY, MOST_SEEDS, OPTIONS, PART, RUNNER, SHORT
from texloom.stages.vocabulary.sizes import parse_size
from texloom.stages.vocabulary.tileable import parse_tileable, tileable_value

Value = str | tuple[Any, ...]
"""of a param: a YAML text, as on the command line, or a tuple of Python, in which a size is (height, width)"""


class RunRequest(pydantic.BaseModel):
    """What is to be run. `OPTIONS` say what each field means; unknown ones are refused."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)

    flow: str
    pictures: tuple[str, ...] = ()
    sources: Mapping[str, str | tuple[str, ...]] = {}
    params: Mapping[str, Value] = {}
    exports: Mapping[str, str] = {}
    size: Value | None = None
    tileable: bool | Literal["off", "x", "y", "both"] | None = None
    preset: str | None = None
    seed: int | None = None
    seeds: int | tuple[int, ...] | None = None
    item: str | None = None
    store: Path | None = None
    remote: str | None = None
    out: Path | None = None
    force: bool = False
    keep: Literal["all", "final"] | None = None
    runner: str | None = None
    workers: int | None = None
    address: str | None = None
    crop: str | None = None
    reduce: str | None = None
    layout: str | None = None
    texel_size: str | None = None
    color_space: str | None = None
    udim: str | None = None
    material: str | None = None

    @property
    def overrides(self) -> Overrides:
        """The changes of the flow.

        Raises
        ------
        InputError : two fields say the same, there are too many seeds, or a picture is a word that can be none.
        """
        for picture in self.pictures:
            _check_picture(picture)
        if empty := [name for name in ("size", "preset") if getattr(self, name) == ""]:
            raise refused(f"--{empty[0]}: the value is empty")
        count = len(self.seeds) if isinstance(self.seeds, tuple) else self.seeds
        if count is not None and not 1 <= count <= MOST_SEEDS:
            raise refused(f"--seeds: must be from 1 to {MOST_SEEDS} seeds")
        if self.seed is not None and isinstance(self.seeds, tuple):
            raise refused("--seed and a range of --seeds say the same; give one of them")
        runner = {name.replace("runner", "name"): value for name, value in self._given(RUNNER).items()}
        return Overrides(
            self.sources, self._params(), self.seed, self.seeds, runner, self.pictures, self.exports,
            self._given(DELIVERY), self._given(PART), self.item, self.keep,
        )  # fmt: skip

    def _given(self, names: tuple[str, ...]) -> dict[str, Any]:
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def _params(self) -> dict[str, Value]:
        short = self._given(SHORT)
        if "tileable" in short:
            value = tileable_value(parse_tileable(self.tileable))
            short["tileable"] = value if isinstance(value, str) else str(value).lower()
        twice = next((name for name in short if name in self.params), None)
        if twice is not None:
            raise refused(f"--{twice} and --set {twice}=... say the same; give one of them")
        return {**self.params, **short}


def _check_picture(picture: str) -> None:
    """`InputError` where a word was meant as a size, as standard input, or is that of an unset variable."""
    if not picture:
        raise refused("PICTURE: the name is empty; give a file, a folder or a pattern")
    try:
        if Path(picture).exists():
            return
    except OSError as error:  # such as a name that is too long
        raise refused(f"PICTURE: {shown(picture)}: cannot be read: {error.strerror}") from None
    if picture == "-":
        raise refused("-: pictures are not read from standard input; give a file")
    if parse_size(picture) is not None:
        raise refused(f"{picture}: no such picture; a size is written --size N or --size WIDTHxHEIGHT")


for _name, _field in RunRequest.model_fields.items():
    _field.description = OPTIONS[_name].help


def request(**fields: Any) -> RunRequest:
    """A `RunRequest`; `InputError` names the field that is wrong."""
    try:
        return RunRequest(**fields)
    except pydantic.ValidationError as error:
        where = error.errors()[0]["loc"][0]
        # of a value that may be of several types, each says what it takes
        told = [one["msg"] for one in error.errors() if one["loc"][0] == where]
        problem = "; or ".join(dict.fromkeys(f"{text[0].lower()}{text[1:]}" for text in told))
        raise refused(f"--{str(where).replace('_', '-')}: {problem}") from None
