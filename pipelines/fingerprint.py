"""Keys: what a step's result depends on, as one digest."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import json
import threading
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import stages
from pipelines.files import file_digest
from pipelines.flow import document_params, file_params
from pipelines.flow_model import Step
from stages.declare import InputError

_parsing = threading.Lock()  # Python 3.11 counts the depth of its parsers in all threads together
_WITH_BODY = (
    *(ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.If, ast.For, ast.While),
    *(ast.AsyncFor, ast.With, ast.AsyncWith, ast.Try, ast.TryStar, ast.ExceptHandler, ast.Match, ast.match_case),
)


@dataclasses.dataclass(frozen=True)
class KeyParts:
    """All that a step's result depends on; two equal ones have equal results."""

    stage: str
    version: int
    code: str
    params: Mapping[str, Any]
    seed: str | None
    inputs: Mapping[str, str]

    @property
    def key(self) -> str:
        """SHA-256, 64 hexadecimal digits."""
        return hashlib.sha256(canonical_json(dataclasses.asdict(self)).encode()).hexdigest()

    def differences(self, earlier: Mapping[str, Any]) -> list[str]:
        """What has changed since ``earlier`` (as `dataclasses.asdict` gives it), in words."""
        changes = []
        if earlier.get("stage") != self.stage:
            changes.append(f"stage: {earlier.get('stage')} -> {self.stage}")
        elif earlier.get("version") != self.version:
            changes.append(f"version of {self.stage}: {earlier.get('version')} -> {self.version}")
        elif earlier.get("code") != self.code:
            changes.append(f"code of {self.stage}")
        before = earlier.get("params", {})
        for name in sorted({*before, *self.params}):
            if before.get(name) != self.params.get(name):
                changes.append(f"param {name}: {_short(before.get(name))} -> {_short(self.params.get(name))}")
        if earlier.get("seed") != self.seed:
            changes.append(f"seed: {earlier.get('seed')} -> {self.seed}")
        before = earlier.get("inputs", {})
        changes += [
            f"input {name}" for name in sorted({*before, *self.inputs}) if before.get(name) != self.inputs.get(name)
        ]
        return changes


def _short(value: Any) -> str:
    if value is None:
        return "none"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def key_parts(step: Step, flow_seed: int, inputs: Mapping[str, str]) -> KeyParts:
    """What the result of ``step`` depends on, given the content digests of its inputs."""
    stage = step.stage
    return KeyParts(
        stage=stage.name,
        version=stage.version,
        code=code_digest(stage.module),
        params=_params(step),
        seed=f"{flow_seed}/{step.draws_as}" if stage.uses_rng else None,
        inputs=dict(sorted(inputs.items())),
    )


def generator(flow_seed: int, step: str) -> np.random.Generator:
    """The random numbers of a step: they depend on the flow's seed and the step's name alone."""
    name = int.from_bytes(hashlib.sha256(step.encode()).digest()[:16], "big")
    return np.random.default_rng([flow_seed, name])


def canonical_json(value: Any) -> str:
    """JSON that is equal for equal values."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=True)


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


@cache
def code_digest(module: str) -> str:
    """Digest of the code of ``module`` and of all modules of texloom that it imports.

    Comments, docstrings and layout do not count.
    """
    pending, seen = [module], set()
    while pending:
        name = pending.pop()
        if name not in seen:
            seen.add(name)
            pending.extend(_imports(name))
    return hashlib.sha256("".join(f"{name}:{_syntax(name)}\n" for name in sorted(seen)).encode()).hexdigest()


@cache
def _path(module: str) -> Path | None:
    """The file of a module of texloom; nothing is imported."""
    stem = Path(stages.__file__).parents[1].joinpath(*module.split("."))
    candidates = (stem.with_suffix(".py"), stem / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


@cache
def _tree(module: str) -> ast.Module:
    path = _path(module)
    if path is None:
        raise ModuleNotFoundError(module)
    with _parsing:
        return ast.parse(path.read_bytes())


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """The module and every statement in it that has a body or imports something."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            pending.extend(part for part in getattr(node, name, ()) if isinstance(part, _WITH_BODY))


@cache
def _syntax(module: str) -> str:
    """Digest of what the code does: no comments, no docstrings of modules, functions, classes and attributes."""
    tree = _tree(module)
    for node in _statements(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            node.body = [part for part in node.body if not _is_text(part)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


@cache
def _imports(module: str) -> tuple[str, ...]:
    """The modules of texloom that ``module`` imports anywhere in its code."""
    found: set[str] = set()
    for node in _statements(_tree(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _imported_from(node, module)
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    ours = {name for name in found if name.startswith(("stages.", "pipelines."))}
    return tuple(sorted(name for name in ours if _path(name) is not None))


def _imported_from(node: ast.ImportFrom, module: str) -> str:
    """The absolute name of what ``module`` says ``from ... import`` of."""
    path = _path(module)
    package = module.split(".") if path is not None and path.name == "__init__.py" else module.split(".")[:-1]
    above = package[: len(package) - node.level + 1] if node.level else []
    return ".".join([*above, *([node.module] if node.module else [])])
