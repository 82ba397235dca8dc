"""Per-pixel synthesis, in the plane and on surfaces."""
