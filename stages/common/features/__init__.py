"""What of an exemplar is compared: control, further maps, labels, tone."""
