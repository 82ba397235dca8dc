"""Textures on the surfaces in photographs."""
