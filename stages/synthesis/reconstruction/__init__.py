"""Synthesis under a control map, by texture optimisation [Kwatra2005]_ and by k-coherence [Tong2002]_.

The reconstruction of inverse texture synthesis [Wei2008]_: `reconstruct` is the stage, `solvers` solve one
scale.
"""
