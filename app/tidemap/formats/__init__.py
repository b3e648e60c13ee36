"""File and wire formats, one a module."""
