"""Votes of a structured forest for the pixels that are contours."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

NODE = np.dtype([("first", np.int32), ("second", np.int32), ("right", np.int32), ("threshold", np.float32)])
"""A node: from the patch's start in the channels, the value that is compared, and where that is a difference the
value that is subtracted, else the same again; the right child, which the left one precedes; values below the
threshold go left. A leaf is its own left child, with a threshold of infinity."""

EVALUATED = 4
"""trees that see each patch"""


@inner
def _next_node(nodes, node, channels, start):
    here = nodes[node]
    subtracted = channels[start + here.second]  # read either way: branches that cannot be predicted take longer
    value = channels[start + here.first] - (np.float32(0) if here.first == here.second else subtracted)
    return here.right - (not value >= here.threshold)


@compiled
def add_votes(channels, row_step, step, patches, nodes, trees, bounds, bins, votes):
    """Let the patches that begin at every second pixel vote for pixels of the 16 x 16 at their centres.

    Parameters
    ----------
    channels : (n,) float32, of half the resolution: of pixels of ``step`` values, ``row_step`` values a row
    patches : how many rows and columns of them
    nodes : (trees * n,) `NODE`, tree by tree
    bounds : (trees * n + 1,) int32, first of the votes of each node among ``bins``
    bins : uint8, pixels that leaves vote for, column by column
    votes : (H, W) uint16, output
    """
    leaves = np.empty(EVALUATED, np.int64)
    for i in range(patches[0]):
        for j in range(patches[1]):
            start = i * row_step + j * step
            for k in range(EVALUATED):
                leaves[k] = ((i + j) % (2 * EVALUATED) + k) % trees * (len(nodes) // trees)
            descends = True
            while descends:  # all at once: each alone would wait for memory
                descends = False
                for k in range(EVALUATED):
                    node = _next_node(nodes, leaves[k], channels, start)
                    descends |= node != leaves[k]
                    leaves[k] = node
            for k in range(EVALUATED):
                for vote in range(bounds[leaves[k]], bounds[leaves[k] + 1]):
                    votes[2 * i + (bins[vote] & 15), 2 * j + (bins[vote] >> 4)] += 1
