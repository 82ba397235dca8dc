"""Geometry of a surface with texture coordinates, and its texels at every level."""
