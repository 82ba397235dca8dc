"""What is measured of a picture beside its exemplar."""
