"""The pages and the 3D viewer of Tidemap."""
