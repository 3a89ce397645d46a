"""Image files: read safely, or refused with one line that says why."""
