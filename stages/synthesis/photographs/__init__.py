"""Textures put into photographs: the reverse of `analysis.photographs` [Eisenacher2008]_."""
