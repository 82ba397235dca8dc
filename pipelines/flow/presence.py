"""What is there of a flow: the steps and exports that remain without the sources that are not given."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Set

from texloom.pipelines.flow.model import Reference

Alternatives = tuple[Reference, ...]
"""of which the first that is there is taken"""


@dataclasses.dataclass(frozen=True)
class Taker:
    """A step or an export, before it is known what is there of that which it takes."""

    inputs: Mapping[str, Alternatives]
    gather: Mapping[str, Alternatives | Mapping[str, Alternatives]] = dataclasses.field(default_factory=dict)
    required: Set[str] = frozenset()
    """of the names of inputs"""
    only: Alternatives = ()
    """what it is left out without: a source, or a condition as one that may be absent"""
    chosen: Alternatives = ()
    """the choice, and the label that it must take"""
    for_sets: bool = False
    """whether it is left out where there is one item alone"""

    def taken(self) -> list[Alternatives]:
        """What it takes."""
        gathered = ([given] if isinstance(given, tuple) else list(given.values()) for given in self.gather.values())
        return [*self.inputs.values(), *itertools.chain(*gathered), *filter(None, [self.only, self.chosen])]


class Presence:
    """Which of all takers remain, and what they take."""

    def __init__(self, takers: Mapping[str, Taker], absent: Set[str], is_set: bool, before: Presence | None = None):
        """Find what remains.

        Parameters
        ----------
        takers : steps, and exports by their files' names.
        absent : the sources that have no file, and the conditions that do not hold.
        is_set : whether there are several items.
        before : the same, before sources that are there have changed what steps take.
        """
        self.takers = takers
        could = {one.name for taker in takers.values() for given in taker.taken() for one in given}
        self.could: Set[str] = could | (set() if before is None else before.could)
        """the steps and sources that something could take"""
        self.absent = absent
        self.is_set = is_set
        self.lacking: dict[str, tuple[str, ...]] = {}
        """name of a taker that cannot be to the sources and conditions that it lacks, or ``set``"""
        while True:
            lacking = {name: lacks for name, taker in takers.items() if (lacks := self._lacks(taker))}
            if lacking == self.lacking:
                break
            self.lacking = lacking
        self.unneeded = self._unneeded()
        """the other steps whose results nothing takes any more"""

    def chosen(self, alternatives: Alternatives) -> Reference | None:
        """The first that is there."""
        return next((one for one in alternatives if not self._lacked(one)), None)

    def is_there(self, name: str) -> bool:
        """Whether a taker remains."""
        return name not in self.lacking and name not in self.unneeded

    def inputs(self, name: str) -> dict[str, Reference]:
        """What a taker takes as inputs."""
        inputs = self.takers[name].inputs
        return {key: one for key, given in inputs.items() if (one := self.chosen(given)) is not None}

    def gathered(self, name: str) -> dict[str, Reference | Mapping[str, Reference]]:
        """What it gathers."""
        gathered: dict[str, Reference | Mapping[str, Reference]] = {}
        for key, given in self.takers[name].gather.items():
            if isinstance(given, tuple):
                if (one := self.chosen(given)) is not None:
                    gathered[key] = one
            elif labelled := {
                label: ref for label, listed in given.items() if (ref := self.chosen(listed)) is not None
            }:
                gathered[key] = labelled
        return gathered

    def used_sources(self) -> set[str]:
        """The sources that those take which remain."""
        taken = [one for name in self.takers if self.is_there(name) for one in self._taken(name)]
        return {one.name for one in taken if one.output is None}

    def passed_over(self, optional: Set[str]) -> tuple[set[str], set[str]] | None:
        """Optional sources of a result that is there, but not taken, as another one is; and that one's.

        None where all sources of results that are passed over go into those that are taken instead.
        """
        for name, taker in self.takers.items():
            if name in self.lacking:
                continue
            for alternatives in taker.taken():
                there = [one for one in alternatives if not self._lacked(one)]
                first = self.chosen(alternatives)
                for other in there[1:]:
                    lost, won = self._sources_of(other) & optional, self._sources_of(first) & optional
                    if not lost <= won:
                        return lost - won, won - lost
        return None

    # -- inside

    def _lacked(self, reference: Reference) -> tuple[str, ...]:
        if reference.output is None:
            return (reference.name,) if reference.name in self.absent else ()
        return self.lacking.get(reference.name, ())

    def _lacks(self, taker: Taker) -> tuple[str, ...]:
        """The sources that a taker lacks."""
        needed: list[Iterable[Alternatives]] = [[one] for one in (taker.only, taker.chosen) if one]
        needed += [[given] for name, given in taker.inputs.items() if name in taker.required]
        needed += [
            [given] if isinstance(given, tuple) else [tuple(itertools.chain(*given.values()))]
            for name, given in taker.gather.items()
            if name in taker.required
        ]
        lacks = ["set"] if taker.for_sets and not self.is_set else []
        for alternatives in itertools.chain(*needed):
            each = [self._lacked(one) for one in alternatives]
            lacks += itertools.chain(*each) if all(each) else ()
        return tuple(dict.fromkeys(lacks))

    def _taken(self, name: str) -> list[Reference]:
        return [one for given in self.takers[name].taken() if (one := self.chosen(given)) is not None]

    def _unneeded(self) -> set[str]:
        """Steps that something could take, but nothing does."""
        unneeded: set[str] = set()
        while True:
            left = [name for name in self.takers if name not in self.lacking and name not in unneeded]
            taken = {one.name for name in left for one in self._taken(name)}
            idle = {name for name in left if name in self.could and name not in taken}
            if not idle:
                return unneeded
            unneeded |= idle

    def _sources_of(self, reference: Reference | None) -> set[str]:
        """The sources that a result comes from."""
        sources: set[str] = set()
        waiting, seen = [reference], set()
        while waiting:
            one = waiting.pop()
            if one is None or one in seen:
                continue
            seen.add(one)
            if one.output is None:
                sources.add(one.name)
            else:
                waiting += self._taken(one.name)
        return sources
