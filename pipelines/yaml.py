"""YAML of plain values: no tags, aliases, merge keys or repeated keys, and not too much of it."""

from __future__ import annotations

import copy
import functools
import re
from pathlib import Path
from typing import Any

import yaml

from texloom.pipelines.errors import refused

_STANDARD = "tag:yaml.org,2002:"
_INT = f"{_STANDARD}int"
_LARGEST = 1 << 20  # bytes of a file


def read_document(path: Path) -> Any:
    """What stands in a flow file, unchecked."""
    try:
        size = path.stat().st_size
        text = path.read_text(encoding="utf-8") if size <= _LARGEST else ""
    except FileNotFoundError:
        raise refused(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise refused(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise refused(f"{path}: cannot be read: {error.strerror}") from None
    if size > _LARGEST:
        raise refused(f"{path}: larger than {_LARGEST} bytes")
    return parse_yaml(text, str(path))


def parse_yaml(text: str, where: str) -> Any:
    """One YAML document of plain values. Tags, aliases and repeated keys are refused."""
    if len(text) > _LARGEST:
        raise refused(f"{where}: larger than {_LARGEST} bytes")
    try:
        return copy.deepcopy(_parsed(text))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise refused(f"{where}: not valid YAML: {error.problem or error.context}{line}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise refused(f"{where}: not valid YAML: {str(error).partition(chr(10))[0]}") from None
    except RecursionError:
        raise refused(f"{where}: not valid YAML: nested too deeply") from None


@functools.lru_cache(256)
def _parsed(text: str) -> Any:
    """Not to be changed: flows include the same files over and over, and PyYAML takes some 25 ms for each."""
    return yaml.load(text, Loader=_PlainLoader)  # noqa: S506 (a SafeLoader)


class _PlainLoader(yaml.SafeLoader):
    # No 0x5 and 1:30, which YAML takes for 5 and 90.
    yaml_implicit_resolvers = {  # noqa: RUF012 (of PyYAML)
        first: [(tag, pattern) for tag, pattern in known if tag != _INT]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    @staticmethod
    def _not_allowed(what: str, mark: Any) -> yaml.MarkedYAMLError:
        return yaml.MarkedYAMLError(None, None, f"{what} are not allowed", mark)

    def compose_node(self, parent: Any, index: int) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            raise self._not_allowed(f"aliases (*{event.anchor})", event.start_mark)
        if event.tag is not None:
            raise self._not_allowed(f"tags ({event.tag.replace(_STANDARD, '!!')})", event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a key must be plain text", key_node.start_mark)
            if key_node.tag == f"{_STANDARD}merge":
                raise self._not_allowed("merge keys (<<)", key_node.start_mark)
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"'{key_node.value}' is given twice", key_node.start_mark
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


_PlainLoader.add_implicit_resolver(_INT, re.compile(r"[-+]?(?:0|[1-9][0-9_]*)$"), list("-+0123456789"))
