"""Helpers of stitched syntheses."""
