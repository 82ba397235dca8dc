"""Candidate sets and discrete synthesis by k-coherence."""
