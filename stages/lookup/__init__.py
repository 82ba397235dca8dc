"""Finding stages by their names, those of plug-ins too, and calling them directly."""
