"""The parts of the search for veins: likelihood, drainage, veins that are made up, and their drawing on a map."""
