"""Choice of a texton for each cell of a result."""

from collections import deque

import numpy as np
from jaxtyping import Int64

from texloom.stages.synthesis.near_regular.exemplar_textons import Textons
from texloom.stages.synthesis.near_regular.lattice_deformation import DIRECTIONS
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice
from texloom.stages.vocabulary.progress import Progress, report

_REPETITION_USES = 4.0  # excess uses whose cost equals that of a texton beside itself
_REPORTED = 64  # nodes between two reports of progress
_SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))


class TextonChoice:
    """Chooses a texton for each node in the order in which the lattice grows from the result's middle.

    See `RegularisedPatchesParams` for ``tolerance``.
    """

    def __init__(self, textons: Textons, lattice: OutputLattice, tolerance: float, rng: np.random.Generator):
        self.textons, self.lattice, self.tolerance, self.rng = textons, lattice, tolerance, rng
        self.sides = lattice.neighbours(_SIDES).tolist()
        both = [(sign * i, sign * j) for i, j in textons.directions for sign in (-1, 1)]
        self.beside = lattice.neighbours(tuple(both)).tolist()
        self.neighbours = lattice.neighbours(DIRECTIONS)
        self.chosen = np.full(len(lattice.steps), -1, np.int64)
        self.uses = np.zeros(len(textons.places), np.int64)

    def run(self) -> Int64[np.ndarray, "nodes"]:  # type: ignore[name-defined]
        """The texton of each node, from the middle outwards."""
        lattice = self.lattice
        first = int(((lattice.places - np.array(lattice.size) / 2) ** 2).sum(axis=1).argmin())
        queue, seen = deque([first]), {first}
        done = 0
        while queue:
            node = queue.popleft()
            for other in self.sides[node]:
                if other >= 0 and other not in seen:
                    seen.add(other)
                    queue.append(other)
            self._choose(node, done)
            done += 1
            if done % _REPORTED == 0 or not queue:
                report(Progress(done / len(self.chosen)))
        return self.chosen

    def _choose(self, node: int, done: int) -> None:
        count = len(self.uses)
        errors, level = self._errors(node)
        step = self.tolerance**2 * level
        costs = errors + step * self.uses / max(1.0, done / count)
        neighbours = self.neighbours[node]
        beside = self.chosen[neighbours[neighbours >= 0]]
        costs[beside[beside >= 0]] += _REPETITION_USES * step
        good = np.flatnonzero(costs <= costs.min() + step)
        texton = int(good[self.rng.integers(len(good))])
        self.chosen[node] = texton
        self.uses[texton] += 1

    def _errors(self, node: int) -> tuple[np.ndarray, float]:
        """Sum over the chosen neighbours of each texton's distance to them, and of their mean square colour."""
        errors, level = np.zeros(len(self.uses)), 0.0
        for side, other in enumerate(self.beside[node]):
            texton = int(self.chosen[other]) if other >= 0 else -1
            if texton >= 0:
                costs = self.textons.costs[side // 2]
                errors += costs[texton] if side % 2 == 0 else costs[:, texton]
                level += float(self.textons.levels[side // 2][texton])
        return errors, level
