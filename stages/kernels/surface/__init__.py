"""Compiled loops over triangles, and over texels beside chart borders."""
