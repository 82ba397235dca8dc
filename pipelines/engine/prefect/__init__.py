"""The only package that imports Prefect."""
