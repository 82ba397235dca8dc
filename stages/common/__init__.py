"""Descriptions of neighbourhoods, control, maps and scales that several groups use."""
