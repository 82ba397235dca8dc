"""Wang tiles [Cohen2003]_: borders, interiors, and shaders that cover a plane [Wei2004]_, [Lagae2006]_."""
