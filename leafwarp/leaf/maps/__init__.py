"""What the leaf is like from place to place, as maps of cells."""
