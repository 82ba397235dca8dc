"""Sessions that update a result while its input changes."""
