"""Pictures as grids: scales, sizes, packing, tiles, and equations on them."""
