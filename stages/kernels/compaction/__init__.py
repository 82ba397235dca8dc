"""Inverse texture synthesis: trees of neighbourhoods and the solver."""
