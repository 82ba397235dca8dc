"""Features that are matched."""
