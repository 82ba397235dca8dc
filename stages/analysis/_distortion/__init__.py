"""Surfaces in photographs: patches, their files, and interpolation of fields."""
