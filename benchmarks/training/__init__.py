"""Training of the contour model that ships with texloom; not part of the package."""
