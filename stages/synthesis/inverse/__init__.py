"""Inverse texture synthesis at one level, and its energy."""
