"""Jacobians, orientation fields, footprints and deformations."""
