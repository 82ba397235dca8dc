"""Wang tiles."""
