"""Helpers of lattices."""
