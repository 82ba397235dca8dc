"""Helpers of contours."""
