"""Draws leaf pictures: shapes, venation, shading and backgrounds, with NumPy and OpenCV alone."""
