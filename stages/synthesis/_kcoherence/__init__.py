"""Helpers of synthesis under control."""
