"""Keys: what a step's result depends on, as one digest."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.engine.code_digest import code_digest
from texloom.pipelines.flow.model import Step
from texloom.pipelines.flow.step_params import document_params, file_params
from texloom.pipelines.store.atomic import file_digest
from texloom.stages.vocabulary.declare import InputError, Stage


@dataclasses.dataclass(frozen=True)
class KeyParts:
    """All that a step's result depends on; two equal ones have equal results."""

    stage: str
    version: int
    code: str
    params: Mapping[str, Any]
    seed: str | None
    inputs: Mapping[str, str]

    @cached_property
    def key(self) -> str:
        """SHA-256, 64 hexadecimal digits."""
        return hashlib.sha256(canonical_json(self.as_dict()).encode()).hexdigest()

    def known_as(self, key: str) -> None:
        """Take over the key of equal parts, as to compute it takes long for thousands."""
        self.__dict__["key"] = key

    def as_dict(self) -> dict[str, Any]:
        """All parts by name, ready for JSON."""
        return {
            "stage": self.stage,
            "version": self.version,
            "code": self.code,
            "params": self.params,
            "seed": self.seed,
            "inputs": self.inputs,
        }

    def differences(self, earlier: Mapping[str, Any]) -> list[str]:
        """What has changed since ``earlier`` (as `as_dict` gives it), in words."""
        changes = []
        if earlier.get("stage") != self.stage:
            changes.append(f"stage: {earlier.get('stage')} -> {self.stage}")
        elif earlier.get("version") != self.version:
            changes.append(f"version of {self.stage}: {earlier.get('version')} -> {self.version}")
        elif earlier.get("code") != self.code:
            changes.append(f"code of {self.stage} changed")
        before = earlier.get("params", {})
        for name in sorted({*before, *self.params}):
            if before.get(name) != self.params.get(name):
                changes.append(f"param {name}: {_short(before.get(name))} -> {_short(self.params.get(name))}")
        if earlier.get("seed") != self.seed:
            changes.append(f"seed: {earlier.get('seed')} -> {self.seed}")
        before = earlier.get("inputs", {})
        changes += [
            f"input {name} changed"
            for name in sorted({*before, *self.inputs})
            if before.get(name) != self.inputs.get(name)
        ]
        return changes


def _short(value: Any) -> str:
    if value is None:
        return "none"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def fixed_parts(step: Step) -> tuple[str, Mapping[str, Any]]:
    """The digest of a step's code, and its params, in which files are their digests."""
    return _code(step.stage), _params(step)


def key_parts(
    step: Step, flow_seed: int, inputs: Mapping[str, str], fixed: tuple[str, Mapping[str, Any]] | None = None
) -> KeyParts:
    """What the result of ``step`` depends on, given its inputs' content digests, and `fixed_parts` if known."""
    stage = step.stage
    code, params = fixed or fixed_parts(step)
    return KeyParts(
        stage=stage.name,
        version=stage.version,
        code=code,
        params=params,
        seed=f"{flow_seed}/{step.draws_as}" if stage.uses_rng else None,
        inputs=dict(sorted(inputs.items())),
    )


def _code(stage: Stage) -> str:
    """Digest of a stage's code; of a plug-in with its distribution and version."""
    digest = code_digest(stage.module)
    return hashlib.sha256(f"{stage.origin}\n{digest}".encode()).hexdigest() if stage.origin else digest


def generator(flow_seed: int, step: str) -> np.random.Generator:
    """The random numbers of a step: they depend on the flow's seed and the step's name alone."""
    name = int.from_bytes(hashlib.sha256(step.encode()).digest()[:16], "big")
    return np.random.default_rng([flow_seed, name])


_encoder = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=True)


def canonical_json(value: Any) -> str:
    """JSON that is equal for equal values."""
    return _encoder.encode(value)


def _params(step: Step) -> dict[str, Any]:
    values: dict[str, Any] = step.params.model_dump(mode="json")

    def digest(param: str, path: str) -> str:
        try:
            return file_digest(Path(path))
        except OSError as error:
            raise InputError(f"steps.{step.name}.params.{param}: {path}: {error.strerror}") from None

    for name in file_params(type(step.params)):
        if values.get(name) is not None:
            values[name] = digest(name, values[name])
    for name in document_params(type(step.params)):
        if values.get(name) is not None:
            pictures = {known: digest(name, path) for known, path in values[name]["pictures"].items()}
            values[name] = {"content": values[name]["content"], "pictures": pictures}
    return values
