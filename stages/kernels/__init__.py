"""Numba loops only: arrays in, arrays filled. Every kernel has a slow readable twin in ``tests/naive.py``."""
