"""The size of the vectors that stand for neighbourhoods; in a module without Numba, which takes long to import."""

DIMENSIONS = 32
"""values of a vector"""
