"""What is made from an exemplar."""
