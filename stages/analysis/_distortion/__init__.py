"""Helpers of photographs: surfaces, their files, and gaps of fields."""
