"""Search of whole cells in an exemplar."""
