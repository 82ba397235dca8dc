"""Flow files: their model, loading and checking."""
