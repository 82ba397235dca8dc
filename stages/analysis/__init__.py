"""What is read from an exemplar."""
