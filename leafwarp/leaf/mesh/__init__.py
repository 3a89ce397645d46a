"""The outline filled with triangles."""
