"""Headless pictures of the leaf."""
