"""The artifact store and its files."""
