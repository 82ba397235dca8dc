"""How the contour model that ships with texloom was made: not part of the product, and not imported by it."""
