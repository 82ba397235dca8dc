"""A photograph to a tileable material in one command: its plane is found and straightened, and maps are estimated.

    python examples/04_photograph.py

The photograph is drawn here, so that it can be shared: a wall seen from the side, darker towards its far end.
"""

import numpy as np
import skimage.io
from scipy.ndimage import map_coordinates

import texloom

wall = texloom.synthesize("texloom:bricks", size=(512, 768), seed=1).image
row, column = np.indices((480, 640))
across = (column + 30) / 730
height = 270 + 350 * across  # of the wall in the photograph, px
places = [512 * (row - 110 + 170 * across) / height, 768 * across * 620 / height]
seen = np.stack([map_coordinates(plane, places, order=1) for plane in np.moveaxis(wall, 2, 0)], axis=2)
skimage.io.imsave("04_photograph.png", np.uint8(seen * np.linspace(0.7, 1, 640)[:, None]))

made = texloom.run("photo_material", {"photo": "04_photograph.png"}, size=256, out="04_photograph")
print(made.exports["texture.png"])
