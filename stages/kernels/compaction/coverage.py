"""How much of a texture's clusters blocks would leave missing."""

from texloom.stages.kernels.core.compiled import compiled


@compiled
def missing_sums(distances, missing, totals):
    """Sum over the clusters of what each block, with those taken before it, lacks of them.

    Parameters
    ----------
    distances : (clusters, blocks) float64, what each block lacks alone
    missing : (clusters,) float64, what those before it lack
    totals : (blocks,) float64, output
    """
    totals[:] = 0
    for cluster in range(distances.shape[0]):
        most = missing[cluster]
        for block in range(distances.shape[1]):
            own = distances[cluster, block]
            totals[block] += own if own < most else most
