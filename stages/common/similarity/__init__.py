"""Neighbourhoods as vectors, and the sets of those that are similar."""
