"""Projects: the materials of a folder, saved as they change, and the wall that shows them."""
