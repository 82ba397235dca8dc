"""Exemplars made ready: cropped, masked, without slow tone."""
