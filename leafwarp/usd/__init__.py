"""USD output."""
