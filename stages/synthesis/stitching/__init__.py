"""Textures stitched from patches of an exemplar."""
