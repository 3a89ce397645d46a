"""Leaf photo to mesh, texture and maps."""
