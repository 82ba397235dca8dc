"""Helpers of syntheses on a lattice."""
