"""Guides, orientation fields and directions that are to be followed."""
