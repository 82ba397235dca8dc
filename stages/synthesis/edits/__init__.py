"""Textures that are edited: revised, refined, filled, laid out by a collage, made even.

Regions are synthesised again by texture optimisation [Kaspar2015]_ between fixed pixels, as completion
[Simakov2008]_ and reshuffling [Barnes2009]_ do; maps are integrated from gradients [Perez2003]_.
"""
