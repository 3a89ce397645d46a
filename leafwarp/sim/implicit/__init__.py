"""Implicit and quasistatic motion: a potential evaluated on the device, minimised by Newton's method on the host."""


class NotConverged(Exception):
    """The minimum of a potential was not found; the message says how far it got."""
