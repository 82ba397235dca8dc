"""Contours, features and the guidance channel of self-tuning [Kaspar2015]_, section 3.1.

Contours by a structured forest [Dollar2013]_, features by Otsu's threshold [Otsu1979]_ or by differences of
Gaussians.
"""
