"""The measured trade between speed and accuracy, on a user's own scene and machine."""
