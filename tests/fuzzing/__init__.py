"""Random damaged scenes and pictures, and a process that lets the command line meet them."""
