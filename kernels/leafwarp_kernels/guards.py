"""Values that cannot be, turned into values that are not a number.

What is not a number spreads to all that is computed from it, down to what the host reads after every step anyway; a
negative mass or a rest angle of infinity, which is cut to a half turn, would not.
"""

from typing import Any

import warp as wp


@wp.func
def if_finite(value: Any, source: Any):
    """The value, if what it comes from is finite; a clamp or a maximum would hide it."""
    if not wp.isfinite(source):
        return type(value)(wp.nan)
    return value


@wp.func
def non_negative(value: Any):
    """The value, if it is finite and not negative."""
    if not (value >= type(value)(0.0) and wp.isfinite(value)):
        return type(value)(wp.nan)
    return value


@wp.func
def positive(value: Any):
    """The value, if it is finite and above 0."""
    if not (value > type(value)(0.0) and wp.isfinite(value)):
        return type(value)(wp.nan)
    return value
