"""Products, solutions and filters whose last bits are the same on every processor."""
