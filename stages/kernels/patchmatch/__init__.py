"""Patch search and voting of texture optimisation."""
