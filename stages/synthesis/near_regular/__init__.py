"""Near-regular textures, made of the tiles of a lattice."""
