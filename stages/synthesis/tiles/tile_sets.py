"""Which sets of tiles between materials are made."""

import dataclasses
from typing import Any, Literal

from texloom.stages.vocabulary.declare import Params, stage

_SETS = {"both": ("corners", "edges"), "corners": ("corners",), "edges": ("edges",)}


class TileSetsParams(Params):
    """The sets that are wanted."""

    sets: Literal["both", "corners", "edges"] = "both"
    """`corners`: a dual grid and blobs, by the materials of corners; `edges`: paths, by the materials that cross
    edges; either takes about half of the time of `both`"""
    labels: tuple[str, ...] = ("corners", "edges")
    """the sets that there are"""


@dataclasses.dataclass(frozen=True)
class TileSets:
    """What was chosen."""

    table: dict[str, Any]
    """`chosen`, a list of sets, and `because`"""


@stage(version=1, role="choice")
def tile_sets(params: TileSetsParams) -> TileSets:
    """Choose which sets of tiles between materials are made; those that are not wanted take no time.

    References
    ----------
    Ours.
    """
    return TileSets({"chosen": list(_SETS[params.sets]), "because": "as asked"})
