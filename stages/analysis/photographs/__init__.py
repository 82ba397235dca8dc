"""Textures on the surfaces in photographs [Eisenacher2008]_.

Surfaces are rational Bézier patches whose Jacobians say how the texture is distorted; flat textures, feature
distances and Gaussian stacks are read along them. Planes are proposed from vanishing points
[LiebowitzZisserman1998]_.
"""
