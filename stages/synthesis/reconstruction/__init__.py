"""Synthesis under a control map, by k-coherence."""
