"""Textures stitched from patches of an exemplar.

Image quilting [Efros2001]_, graph-cut textures [Kwatra2003]_, patch-based sampling [Liang2001]_, hybrid
[Nealen2003]_ and adaptive [Ding2014]_ patches, with the min-cut of [Kolmogorov2004]_. Other rooms take its
cuts, seam costs and template matching.
"""
