"""Per-pixel synthesis at every level, as `per_pixel` and `Canvas` use it."""
