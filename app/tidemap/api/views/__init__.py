"""Wire forms of what the services take and return, one resource a module."""
