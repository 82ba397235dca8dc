"""Kernels and helpers that every room uses: threads, short vectors, resampling."""
