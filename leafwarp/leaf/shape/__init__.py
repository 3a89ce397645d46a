"""The leaf's outline and where its petiole ends."""
