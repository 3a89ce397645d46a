"""Which part of the picture is the leaf."""
