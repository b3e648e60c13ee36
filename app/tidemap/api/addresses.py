"""Where the API begins."""

BASE = "/api/v1"
