"""Textures that are edited: revised, refined, filled, laid out, made even."""
