"""Similar neighbourhoods of an exemplar."""
