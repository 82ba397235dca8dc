"""Horizons of heights."""
