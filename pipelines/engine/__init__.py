"""Running flows: keys, plans, the scheduler, tasks and events."""
