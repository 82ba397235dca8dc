"""Helpers of texture optimisation."""
