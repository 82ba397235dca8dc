"""Contours, features and the guidance channel."""
