"""Textures that are distorted in their picture."""
