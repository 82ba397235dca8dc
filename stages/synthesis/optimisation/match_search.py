"""The search step of texture optimisation: better matches for all target patches, all cores, one result."""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, Int32, Int64, UInt8

from texloom.stages.common.similarity.neighbourhoods import UNIT
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.kernels.core.threads import spans
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.overuse import Overuse
from texloom.stages.synthesis.optimisation.several_exemplars import Balance
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.scratch import bands, empty, run_bands, run_released

_STRIP = 32  # rows; thinner strips propagate good matches too slowly
_MIN_RADIUS = 5  # px, of random search
_FORBIDDEN = 2**60  # penalty of masked patches, above every cost


@dataclass(frozen=True)
class Effort:
    """Effort of one search step."""

    sweeps: int
    tries: int
    """random tries around the match; 0 for none"""
    fill_tries: int
    """tries at little used places"""
    tolerance: float
    """share of changed matches below which no further sweep is made"""
    narrow: bool = False
    """random and little used places are tried in the first sweep only, the first anywhere and each further one
    nearer to the match [Barnes2009]_; the sweeps that follow propagate. Else those of the first sweep anywhere, and
    in each that follows one fewer, at least one, half as far"""

    distance_per_try: float = 0.0
    """a patch has one of the random tries, the nearest first, for every such multiple of the mean distance of all;
    0 for all tries at every patch"""

    def radii(self, sweep: int, farthest: int) -> Int64[np.ndarray, "tries"]:
        """How far from the match each random try of a sweep may be, px."""
        if not self.tries or (self.narrow and sweep):
            return np.zeros(0, np.int64)
        if self.narrow:
            return _narrowing(max(_MIN_RADIUS, farthest), self.tries)
        return np.full(max(1, self.tries - sweep), max(_MIN_RADIUS, farthest >> sweep), np.int64)

    def fills(self, sweep: int) -> int:
        """Tries at little used places in a sweep."""
        return 0 if self.narrow and sweep else self.fill_tries


def strip_phases(rows: int) -> list[list[tuple[int, int]]]:
    """Strips of rows, from first to last, that are searched together while those between them do not change.

    Their number is even, so that this also applies across the border of a torus.
    """
    strips = spans(rows, max(1, rows // (2 * _STRIP) * 2))
    return [strips[0::2], strips[1::2]] if len(strips) > 1 else [strips]


@functools.lru_cache
def _narrowing(farthest: int, tries: int) -> np.ndarray:
    return np.asarray(np.rint(farthest * exp(np.linspace(0, 1, tries) * log(_MIN_RADIUS / farthest))), np.int64)


class Search:
    """Search at one scale: the exemplar is fixed, the target and the correspondence change.

    Parameters
    ----------
    exemplar : fixed-point features, rows of width * channels values.
    places : exemplar patches down and across.
    wrap : where the target wraps.
    occurrence : weight of the spatial uniformity term, CIELAB units squared.
    overuse : the occurrence, in multiples of even use, at which random search rejects a patch.
    allowed : the permitted exemplar patches, which include all initial matches; none permits all.
    expected : use of each exemplar patch, relative to even use, at which its occurrence penalty is ``occurrence``;
        none for even use of all.
    balance : a price on exemplars that give more than their share, or on regions that are used too often; or none.
    """

    def __init__(
        self,
        exemplar: Int16[np.ndarray, "h wc"],
        channels: int,
        patch_size: int,
        places: tuple[int, int],
        patches: tuple[int, int],
        wrap: Wraps,
        occurrence: float,
        overuse: float,
        allowed: Allowed | None = None,
        expected: Float32[np.ndarray, "p q"] | None = None,
        balance: Balance | Overuse | None = None,
    ):
        from texloom.stages.kernels.patchmatch.search import ALL_ACTIVE, PatchShape

        self.shape = PatchShape.of(patch_size, channels)
        self.exemplar = exemplar
        self.wrap = wrap
        self.unit = UNIT**2 * patch_size**2
        # Even use of the exemplar, [Kaspar2015]_ (4), with the number of patches for |T| as in the authors' code.
        pixels = exemplar.shape[0] * exemplar.shape[1] / channels
        if allowed is not None:
            pixels = int(allowed.pixels.sum())
        even = patches[0] * patches[1] / pixels * patch_size**2
        self.even_penalty = occurrence * self.unit
        self.penalty_per_use = self.even_penalty / even
        self.penalty_limit = int(overuse * self.even_penalty)
        self.expected = expected
        self.balance = balance
        self.compared = 0
        """patch distances so far, whole or until they exceeded the best"""
        self.forbidden = None if allowed is None else ~allowed.places
        self.counts: Int32[np.ndarray, "h w"] = np.empty(places, np.int32)
        self.penalty: Float32[np.ndarray, "h w"] = np.empty(places, np.float32)
        self.distance: Int64[np.ndarray, "p q"] = empty(patches, np.int64)
        self.active: UInt8[np.ndarray, "p q"] = empty(patches, np.uint8)
        self.active[:] = ALL_ACTIVE
        self.phases = strip_phases(patches[0])

    def step(
        self, target: Int16[np.ndarray, "H Wc"], match: Patches, effort: Effort, random: np.random.Generator
    ) -> tuple[float, float, float]:
        """Improve ``match`` in place.

        Returns
        -------
        energy per patch and the occurrence penalty in it, CIELAB units squared; share of changed matches.
        """
        from texloom.stages.kernels.patchmatch.search import (
            Scan,
            SearchedExemplar,
            Target,
            count_moves,
            match_distances,
            match_energy,
            sweep,
        )

        row, column = match
        own = Target(target, row, column, self.distance, self.active)
        used = (target, match, self.distance, self.active)
        distance = sum(run_bands(match_distances, (self.shape, own, self.exemplar), row.shape[0], used))
        per_try = 0
        if effort.distance_per_try:
            per_try = max(1, int(effort.distance_per_try * distance / row.size))
        self._count(match)
        total = 0
        forward = bool(random.integers(2))
        for sweep_number in range(effort.sweeps):
            radii, fills = effort.radii(sweep_number, max(self.counts.shape)), effort.fills(sweep_number)
            key = random.integers(2**64, dtype=np.uint64)
            # Where little used places are tried, penalties change so much that what was refused may be taken.
            everywhere = sweep_number == 0 or radii.size > 0 or effort.fill_tries > 0
            changed = 0
            for number, phase in enumerate(self.phases):
                if self.balance is not None:
                    self.balance.adjust(self.counts, distance / row.size / self.unit)
                self._set_penalties()
                if number == 0:
                    unused = self._little_used() if fills else (np.zeros(1, np.int32),) * 2
                exemplar = SearchedExemplar(
                    self.exemplar, self.penalty, np.int64(round(self.penalty_per_use)),
                    np.int64(self.penalty_limit), *unused,
                )  # fmt: skip
                scan = Scan(
                    forward, self.wrap, radii, np.int64(per_try), fills if unused[0].size else 0, key, everywhere
                )
                calls = [(self.shape, own, exemplar, scan, *span) for span in phase]
                for moves, distances in run_released(sweep, calls, used):
                    count_moves(moves, self.counts.reshape(-1))
                    changed += len(moves)
                    self.compared += distances
            total += changed
            if changed <= effort.tolerance * row.size:
                break
            forward = not forward
        self._set_penalties()
        sums = run_bands(match_energy, (row, column, self.distance, self.penalty), row.shape[0], used)
        energy, penalty = (sum(part) for part in zip(*sums, strict=True))
        patches = row.size * self.unit
        return (energy + penalty) / patches, penalty / patches, total / row.size

    def _count(self, match: Patches) -> None:
        """Set `counts` to how often each exemplar patch is a match."""
        from texloom.stages.kernels.patchmatch.search import count_matches

        self.counts[:] = 0
        for band in bands(match.shape[1], match):
            count_matches(match[0, band], match[1, band], self.counts)

    def _set_penalties(self) -> None:
        """Set `penalty` by `counts`."""
        from texloom.stages.kernels.patchmatch.search import occurrence_penalty

        occurrence_penalty(self.counts, self.shape.size, self.penalty_per_use, self.penalty)
        if self.expected is not None:
            np.divide(self.penalty, self.expected, out=self.penalty)
            np.rint(self.penalty, out=self.penalty)
        if self.balance is not None:
            self.balance.charge(self.penalty, self.unit)
        if self.forbidden is not None:
            np.copyto(self.penalty, _FORBIDDEN, where=self.forbidden)

    def _little_used(self) -> tuple[np.ndarray, np.ndarray]:
        """Exemplar patches sampled from the density max(0, 1 - occurrence / even use)."""
        lack = np.maximum(0, np.int64(self.even_penalty) - self.penalty.astype(np.int64))
        if self.expected is not None:
            lack = np.rint(lack * self.expected).astype(np.int64)
        lack = np.cumsum(lack.ravel())
        if lack[-1] == 0:
            return np.zeros(0, np.int32), np.zeros(0, np.int32)
        draws = min(lack.size, 1 << 16)
        drawn = np.searchsorted(lack, (np.arange(draws) + 0.5) / draws * lack[-1])
        row, column = np.divmod(np.minimum(drawn, lack.size - 1), self.penalty.shape[1])
        return row.astype(np.int32), column.astype(np.int32)


def occurrence_map(
    match: Patches, shape: tuple[int, int], patch_size: int, usable: int | None = None
) -> Float32[np.ndarray, "h w"]:
    """Number of target patches over each pixel of an exemplar of ``shape``, relative to even use of all pixels.

    Even use is that of ``usable`` pixels, if not all are. [Kaspar2015]_ equations (3) and (4).
    """
    from texloom.stages.kernels.patchmatch.search import count_matches

    steps = np.zeros((shape[0] + 1, shape[1] + 1), np.int64)
    places = (shape[0] - patch_size + 1, shape[1] - patch_size + 1)
    uses = np.zeros(places, np.int32)
    for band in bands(match.shape[1], match):
        count_matches(match[0, band], match[1, band], uses)
    for down in (0, patch_size):
        for across in (0, patch_size):
            part = steps[down : down + places[0], across : across + places[1]]
            (np.add if down == across else np.subtract)(part, uses, out=part)
    for axis in (0, 1):
        np.cumsum(steps, axis=axis, out=steps)
    even = match[0].size * patch_size**2 / (usable or shape[0] * shape[1])
    relative = np.empty(shape, np.float32)
    for band in bands(shape[0]):
        relative[band] = steps[:-1, :-1][band] / even
    return relative
