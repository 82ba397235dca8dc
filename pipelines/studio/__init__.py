"""The studio: a server for one browser page, whose every action is a flow with sources and parameters."""
