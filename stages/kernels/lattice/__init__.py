"""Scores, deformations and textons of a lattice."""
