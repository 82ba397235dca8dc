"""Textures in and out: decoding, sources, material sets."""
