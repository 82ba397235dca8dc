"""Textures put into photographs."""
