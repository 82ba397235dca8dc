"""Textures without end: by-example noise and hex tiling for shaders."""
