"""A whole material: four maps in, four maps in register out, and a picture of it under a moving light.

    python examples/03_material.py

A folder of maps as downloaded does as well: its names tell which map is which.
"""

import texloom

made = texloom.run("materials", size=384, seed=1, out="03_material")
print("\n".join(sorted(made.exports)))
