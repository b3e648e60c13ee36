"""Tidemap: a map service for robots that live in one place for months."""

__version__ = "0.1.0"
