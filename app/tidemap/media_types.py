"""Media types: what bodies and answers are written in."""

ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"
NPY = "application/x-npy"
PROBLEM = "application/problem+json"
PCD = "application/x-pcd"
PLY = "application/x-ply"
MULTIPART = "multipart/form-data"
