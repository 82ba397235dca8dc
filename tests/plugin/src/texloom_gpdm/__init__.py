"""Patch-distribution matching as a stage of texloom."""
