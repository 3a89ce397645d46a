"""Studies that run the public API many times."""
