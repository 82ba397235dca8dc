"""Cells, phases and repetition of regular textures."""
