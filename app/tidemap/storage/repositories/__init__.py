"""Repositories: one a table or two, on one connection."""
