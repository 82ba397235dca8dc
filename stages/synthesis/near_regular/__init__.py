"""Near-regular textures, made of the tiles of an exemplar's lattice [LiuTsin2004]_, [Lin2004]_.

`near_regular` draws tiles at random; `regularised_patches` chooses textons and deforms the lattice of the
result.
"""
