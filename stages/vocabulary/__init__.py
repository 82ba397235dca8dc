"""What all stages speak of: arrays and their names, declarations, sizes, masks, colour, progress."""
