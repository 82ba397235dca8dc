"""Inverse texture synthesis [Wei2008]_: a small compaction that represents a large texture.

Also what is done with compactions, `atlas` and `propagate_edit`, and their baselines: epitomes [Jojic2003]_,
seam carving [Avidan2007]_, the best crop, and a summary of colour histograms [Kopf2007]_.
"""
