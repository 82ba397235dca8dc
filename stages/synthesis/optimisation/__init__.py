"""Texture optimisation: patch search and voting alternate from coarse to fine.

Self-tuning [Kaspar2015]_, after [Kwatra2005]_ and with the search of [Barnes2009]_; image melding
[Darabi2012]_; bidirectional similarity [Simakov2008]_. `match_search` and `vote` are the two steps, `features`
what is compared, `coarse_to_fine` the loop that all of them share, `scale` the iterations at one scale. At the end
`seam_relaxation` moves seams, and `cell_completion` and `cells` make cells whole.
"""
