"""Overlaps, minimum cuts, expansion moves and seam carving."""
