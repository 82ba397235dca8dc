"""Helpers of inverse texture synthesis."""
