"""Report pages and what they show."""
