"""Meshes: charts, control and direction on a surface."""
