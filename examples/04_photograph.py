"""A photograph to a tileable material in one command: its plane is found and straightened, and maps are estimated.

    python examples/04_photograph.py

The photograph is drawn here, so that it can be shared: a wall seen from the side, darker towards one end.
"""

import cv2
import numpy as np
import skimage.io

import texloom

wall = texloom.synthesize("texloom:bricks", size=(512, 768), seed=1).image
corners = np.float32([[0, 0], [768, 0], [768, 512], [0, 512]])
seen = np.float32([[-30, 110], [700, -60], [700, 560], [-30, 380]])
turned = cv2.warpPerspective(wall, cv2.getPerspectiveTransform(corners, seen), (640, 480), flags=cv2.INTER_AREA)
shade = np.linspace(0.7, 1, 640)[None, :, None]
skimage.io.imsave("04_photograph.png", (turned * shade).astype(np.uint8))

made = texloom.run("photo_material", {"photo": "04_photograph.png"}, size=256, out="04_photograph")
print(made.exports["texture.png"])
