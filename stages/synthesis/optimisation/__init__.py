"""Texture optimisation by patch search and voting."""
