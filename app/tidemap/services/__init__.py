"""Use cases, one a module; each opens its own unit of work."""
