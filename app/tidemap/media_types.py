"""Media types: what bodies and answers are written in."""

ARROW = "application/vnd.apache.arrow.stream"
EVENT_STREAM = "text/event-stream"
JSON = "application/json"
NPY = "application/x-npy"
PROBLEM = "application/problem+json"
