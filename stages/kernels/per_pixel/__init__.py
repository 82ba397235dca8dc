"""Parallel per-pixel synthesis on processors and GPUs."""
