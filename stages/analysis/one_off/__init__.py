"""What an exemplar shows once: parts that the rest of it does not explain, and what crosses it once."""
