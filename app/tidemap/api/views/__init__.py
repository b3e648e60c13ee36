"""Wire forms of what the services return, one resource a module."""
