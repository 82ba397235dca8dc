"""Overlaps, minimum cuts and seam carving."""
