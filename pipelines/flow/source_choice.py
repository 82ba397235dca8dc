"""The sources of a flow: those of its file, and what the caller gives instead."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from texloom.pipelines.errors import hint, refused, shown
from texloom.pipelines.flow.draft import Draft, Entry
from texloom.pipelines.flow.model import Each, Overrides
from texloom.pipelines.flow.schema import REQUIRED, SetPart, is_optional
from texloom.pipelines.flow.shipped import flow_word
from texloom.pipelines.flow.source_files import is_pattern, matching, source_of, stack_of
from texloom.pipelines.flow.step_params import resolved
from texloom.pipelines.media.material_set import is_map_set
from texloom.pipelines.media.stack import SCHEME


class SourceChoice:
    """What each source of a draft is, with what the caller changes."""

    def __init__(self, draft: Draft, overrides: Overrides):
        self.draft = draft
        self.overrides = overrides

    def named(self) -> tuple[dict[str, str | Each], tuple[str, ...], tuple[str, ...]]:
        """The sources by name, and the names of required and of optional ones that are missing."""
        sources: dict[str, str | Each] = {}
        chosen = self.chosen()
        missing, left_out = [], []
        for name, entry in self.draft.sources.items():
            part = entry.value
            if isinstance(part, SetPart) and part.optional is not None and (part.each or part.stack):
                raise entry.fail("is either optional or has files of its own, by 'each' or 'stack'")
            if name in chosen:
                sources[name] = _chosen_source(name, chosen[name], entry)
            elif is_optional(part):
                left_out.append(name)
            else:
                sources[name] = _declared_source(name, entry)
                if _is_required(entry.value):
                    missing.append(name)
            if name in sources and name not in missing and isinstance(part, SetPart):
                _check_count(name, sources[name], part.least)
        for name, entry in self.draft.sources.items():
            if name in sources and isinstance(entry.value, SetPart) and entry.value.pair is not None:
                sources[name] = self._paired(name, entry.value, sources)
        return sources, tuple(missing), tuple(left_out)

    def chosen(self) -> dict[str, str | Sequence[str]]:
        """What replaces the sources of the file."""
        chosen, known = dict(self.overrides.sources), self.draft.sources
        for name in chosen:
            if name not in known:
                raise refused(f"--source {name}: the flow has no such source{hint(name, known)}")
        if pictures := self.overrides.pictures:
            if not known:
                told = f"sources: the flow takes no picture, got {shown(pictures[0])}"
                raise refused(f"{flow_word(self.draft.path)}: {told}")
            first = next(iter(known))
            if first in chosen:
                raise refused(f"--source {first}: {pictures[0]} is given as '{first}' too; give one of them")
            chosen[first] = pictures
        return chosen

    def _paired(self, name: str, part: SetPart, sources: Mapping[str, str | Each]) -> str | Each:
        """The source called ``name``, whose set goes with that of ``part.pair``."""
        source, entry, pair = sources[name], self.draft.sources[name], str(part.pair)
        other, partner = sources.get(pair), self.draft.sources.get(pair)
        if other is None or partner is None:
            raise entry.fail(f"no source '{pair}'{hint(pair, sources)}", "pair")
        if isinstance(partner.value, SetPart) and partner.value.pair is not None:
            raise entry.fail(f"'{pair}' must be another source, without 'pair'", "pair")
        if not isinstance(source, Each) or isinstance(other, Each):
            return source
        if part.is_required or part.optional is not None:
            return dataclasses.replace(source, pair=None)
        if pair in self.chosen():
            raise refused(
                f"--source {pair}: takes a folder or a quoted pattern, as '{pair}s/*.png', got {shown(other)}"
            )
        raise entry.fail(f"'{pair}' must be a source with 'each'", "pair")


def _chosen_source(name: str, given: str | Sequence[str], entry: Entry) -> str | Each:
    """What the caller gives, as the source that an entry declares."""
    references = [absolute(one, Path.cwd()) for one in ([given] if isinstance(given, str) else given)]
    if not isinstance(entry.value, SetPart):
        return source_of(name, references, None, is_map_set(absolute(entry.value, entry.path.parent)))
    if entry.value.stack is not None:
        return stack_of(name, references)
    return source_of(name, references, entry.value.pair, False, entry.value.ordered)


def _check_count(name: str, source: str | Each, least: int) -> None:
    """`InputError` where a source has fewer than ``least`` files."""
    if least < 2:
        return
    patterns = [source] if isinstance(source, str) else source.patterns
    files = {file for one in patterns for file in (matching(one).files if is_pattern(one) else [one])}
    if len(files) < least:
        raise refused(f"sources.{name}: {least} pictures or more are needed, got {len(files)}")


def _declared_source(name: str, entry: Entry) -> str | Each:
    """The source of an entry that nothing replaces."""
    value, folder = entry.value, entry.path.parent
    if not isinstance(value, SetPart):
        return absolute(value, folder)
    if value.stack is not None:
        if value.each is not None or value.pair is not None:
            raise entry.fail("is either a 'stack' or a set with 'each'")
        return SCHEME + absolute(value.stack, folder)
    if value.is_required:
        return absolute(REQUIRED, folder)
    if isinstance(value.each, list):
        references = [absolute(one, folder) for one in value.each]
        return source_of(name, references, value.pair, False, value.ordered)
    if value.each is None or not is_pattern(value.each):
        raise entry.fail(f"must be a pattern like 'folder/*.png', got {shown(value.each)}", "each")
    return Each((absolute(value.each, folder),), value.pair)


def _is_required(value: str | SetPart) -> bool:
    """Whether a source has no file unless the caller gives one."""
    if isinstance(value, SetPart):
        return value.is_required or value.stack == REQUIRED
    return value == REQUIRED


def absolute(reference: str, base: Path) -> str:
    """A source's reference, with a relative path resolved against ``base``."""
    if re.match(r"[a-z][a-z0-9]+:", reference):
        return reference
    return resolved(reference, base)
