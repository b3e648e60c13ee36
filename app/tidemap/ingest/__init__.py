"""From what robots send to measurements."""
