"""Flows of this package."""
