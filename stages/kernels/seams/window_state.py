"""What a minimum cut may do with each pixel of a window."""

ABSENT, KEPT, FREE, FILLED = range(4)
"""state of a pixel: has no source, keeps its source, may take either, takes the new one"""
