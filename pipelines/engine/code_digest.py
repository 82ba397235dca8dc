"""Digests of code: of a module with all modules of texloom, or of its own package, that it imports.

Nothing is imported for it.
"""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import importlib.util
import sys
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from texloom.pipelines.engine import user_cache

_TABLE = "code"
_PACKAGE = "texloom."
_ROOT = Path(__file__).parents[2]
_parsing = threading.Lock()  # Python 3.11 counts the depth of its parsers in all threads together
_WITH_BODY = (
    *(ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.If, ast.For, ast.While),
    *(ast.AsyncFor, ast.With, ast.AsyncWith, ast.Try, ast.TryStar, ast.ExceptHandler, ast.Match, ast.match_case),
)


@cache
def code_digest(module: str) -> str:
    """Digest of the code of ``module`` and of all modules of texloom, and of its own package, that it imports.

    Comments, docstrings and layout do not count. The data files of a module do: those beside it that have its name,
    as ``report.html.j2`` beside ``report.py``. Of any other file that a stage reads, its module must hold a digest,
    as `texloom.stages.analysis.structure.edges` does of the contour model.
    """
    known = len(_known())
    pending, seen = [module], set()
    while pending:
        name = pending.pop()
        if name not in seen:
            seen.add(name)
            pending.extend(imports(name))
    if len(_known()) > known:
        user_cache.save(_TABLE, _known())
    lines = [f"{name}:{_summary(name).syntax}\n" for name in sorted(seen)]
    lines += [f"{name}:{file}\n" for name in sorted(seen) for file in _data_digests(name)]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def imports(module: str) -> list[str]:
    """The modules of texloom that ``module`` imports anywhere in its code."""
    return [name for name in _summary(module).imports if _path(name) is not None]


@cache
def _path(module: str) -> Path | None:
    """The file of a module of texloom or of a plug-in; nothing is imported."""
    top, *inner = module.split(".")
    root = _ROOT if f"{top}." == _PACKAGE else _plugin_root(top)
    if root is None:
        return None
    stem = root.joinpath(*inner) if inner else root
    candidates = (stem.with_suffix(".py"), stem / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


@cache
def _plugin_root(top: str) -> Path | None:
    """The folder of a package of another distribution, or the file of a module without its suffix."""
    spec = importlib.util.find_spec(top)  # imports nothing, as it is no module inside of a package
    if spec is None:
        return None
    folders = list(spec.submodule_search_locations or [])
    return Path(folders[0]) if folders else Path(spec.origin or "").with_suffix("")


def _data_digests(module: str) -> list[str]:
    """Name and digest of each data file of ``module``."""
    path = _path(module)
    files = [] if path is None else _data_files(path.parent).get(path.stem, [])
    return [f"{file.name}:{hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files]


@cache
def _data_files(folder: Path) -> dict[str, list[Path]]:
    """The files of a folder that are not Python's, by the stem of the module that they belong to."""
    files: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        stem, _, suffixes = path.name.partition(".")
        if stem and suffixes and not suffixes.startswith("py"):
            files.setdefault(stem, []).append(path)
    return files


@dataclasses.dataclass(frozen=True)
class _Summary:
    """What counts of a module's source."""

    syntax: str
    """digest of what the code does: no comments, no docstrings of modules, functions, classes and attributes"""
    imports: tuple[str, ...]
    """what it may import of texloom: modules, and names that may be modules"""


@cache
def _summary(module: str) -> _Summary:
    """From earlier processes, if they have met the very same source: parsing all of it takes a while."""
    path = _path(module)
    if path is None:
        raise ModuleNotFoundError(module)
    source, is_package = path.read_bytes(), path.name == "__init__.py"
    key = hashlib.sha256(f"{_parser()} {module} {is_package}\n".encode() + source).hexdigest()
    found = _known().get(key)
    if found is None:
        with _parsing:
            tree = ast.parse(source)
        found = _known()[key] = [_syntax(tree), sorted(_imported(tree, module, is_package))]
    return _Summary(found[0], tuple(found[1]))


@cache
def _known() -> dict[str, Any]:
    """Summaries by the digest of all that they depend on."""
    return user_cache.load(_TABLE)


@cache
def _parser() -> str:
    """Tells versions of Python and of this file apart."""
    return f"{sys.version} {hashlib.sha256(Path(__file__).read_bytes()).hexdigest()}"


def _imported(tree: ast.Module, module: str, is_package: bool) -> set[str]:
    found: set[str] = set()
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _imported_from(node, module, is_package)
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    own = f"{module.partition('.')[0]}."
    return {name for name in found if f"{name}.".startswith(own) or name.startswith(_PACKAGE)}


def _imported_from(node: ast.ImportFrom, module: str, is_package: bool) -> str:
    """The absolute name of what ``module`` says ``from ... import`` of."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    above = package[: len(package) - node.level + 1] if node.level else []
    return ".".join([*above, *([node.module] if node.module else [])])


def _syntax(tree: ast.Module) -> str:
    """Digest of a module without docstrings; they are taken out of ``tree``."""
    for node in _statements(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            node.body = [part for part in node.body if not _is_text(part)]
    written: list[str] = []
    _write(tree, written)
    return hashlib.sha256("".join(written).encode()).hexdigest()


def _write(part: Any, written: list[str]) -> None:
    """Append what the parser found to ``written``, in the same words with every supported version of Python.

    Versions add fields, which are empty where the source does not use what is new, and differ in how they cut the
    text of f-strings. So fields that are absent or empty are left out, and text is joined.
    """
    if isinstance(part, ast.AST):
        fields = [(name, getattr(part, name, None)) for name in part._fields]
        if isinstance(part, ast.Constant):
            fields = [("value", f"{type(part.value).__name__} {part.value!a}")]
        elif isinstance(part, ast.JoinedStr):
            fields = [("values", _joined(part.values))]
        written.append(f"{type(part).__name__}(")
        for name, value in fields:
            if value is not None and value != []:
                written.append(f"{name}=")
                _write(value, written)
        written.append(")")
    elif isinstance(part, list):
        written.append("[")
        for entry in part:
            _write(entry, written)
        written.append("]")
    else:
        written.append(f"{part!a},")


def _joined(values: list[ast.expr]) -> list[ast.expr]:
    """The parts of an f-string, without empty text and with text in one piece between two fields."""
    parts: list[ast.expr] = []
    for value in values:
        if isinstance(value, ast.Constant) and parts and isinstance(parts[-1], ast.Constant):
            parts[-1] = ast.Constant(str(parts[-1].value) + str(value.value))
        elif not (isinstance(value, ast.Constant) and value.value == ""):
            parts.append(value)
    return parts


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """The module and every statement in it that has a body or imports something."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            pending.extend(part for part in getattr(node, name, ()) if isinstance(part, _WITH_BODY))


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
