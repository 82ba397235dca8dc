"""Lattices, courses and other repetition of an exemplar.

Peaks of the autocorrelation by their regions of dominance [Lin2004]_, [Liu2004]_; offset statistics
[Kaspar2015]_; lattices whose vertices deviate, and exemplars straightened by them [Lin2004]_.
"""
