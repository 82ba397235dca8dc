"""Numba loops only: arrays in, arrays filled. Slow readable twins stand beside their tests, in ``naive.py``."""
