"""A first texture: bricks that ship with texloom become a larger wall, which is scored against them.

    python examples/01_first_texture.py

The second run reads the result from the store: try it, then change the seed.
"""

import texloom

wall = texloom.synthesize("texloom:bricks", size=(256, 384), seed=1)
wall.save("01_first_texture.png")
print({name: score for name, score in wall.scores["summary"].items() if score is not None})
