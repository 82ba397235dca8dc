"""What light adds to the colour of a surface: cast shadows, reflections, clipped highlights."""
