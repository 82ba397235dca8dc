"""A correction: a bad spot of a texture is synthesised again, and all the rest stays bit-identical.

python examples/05_correction.py
"""

import numpy as np
import skimage.io

import texloom

made = texloom.synthesize("skimage:gravel", size=256, crop="256x256", seed=1, preset="fast")
spot = np.zeros((256, 256), np.uint8)
spot[80:170, 90:190] = 255
sources = {"texture": made.image, "exemplar": "skimage:gravel", "region": spot}
done = texloom.run("revise", sources, seed=2, out="05_correction")

corrected = skimage.io.imread(done.exports["texture.png"])
changed = (corrected != made.image) & (spot == 0)
print(np.count_nonzero(changed), "pixels outside of the spot changed")
