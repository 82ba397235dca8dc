"""Per-pixel synthesis in any order, in the plane [LefebvreHoppe2005]_ and on surfaces [LefebvreHoppe2006]_.

The levels themselves are in `texloom.stages.common.per_pixel`, which the canvas of `interactive` uses too.
"""
