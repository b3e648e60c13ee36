"""The version. In a module of its own, so that no part of the package has to import the whole."""

__version__ = "0.1.0"
