"""Lattices, courses and other repetition."""
