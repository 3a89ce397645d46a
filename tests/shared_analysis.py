"""What is found in a picture, computed once for all tests that prepare a leaf from it."""

from __future__ import annotations

import copy
import hashlib
import io
import pickle
from collections.abc import Callable
from pathlib import PurePath
from typing import Any

import pytest

from leafwarp.leaf.maps import make
from leafwarp.leaf.mesh import triangulate
from leafwarp.leaf.segment import silhouette
from leafwarp.leaf.shape import outline
from leafwarp.leaf.venation import veins

# What prepare_leaf looks up anew at every call; a test that imports one of them has the function itself.
STEPS = (
    (silhouette, "silhouette"),
    (outline, "find_outline"),
    (veins, "find_venation"),
    (make, "stalk_cells"),
    (triangulate, "fill_leaf"),
)
PLAIN = {name: getattr(module, name) for module, name in STEPS}


class _Contents(pickle.Pickler):
    """Pickles values without the paths of the files that they came from: those stand in messages alone."""

    def reducer_override(self, value: Any) -> Any:
        return (str, ()) if isinstance(value, PurePath) else NotImplemented


def _once(function: Callable) -> Callable:
    """The function, which computes once for each contents of its arguments; whoever asks gets a copy."""
    results: dict[bytes, Any] = {}

    def shared(*arguments: Any, **named: Any) -> Any:
        stream = io.BytesIO()
        _Contents(stream, protocol=5).dump((arguments, named))
        key = hashlib.blake2b(stream.getbuffer()).digest()
        if key not in results:
            results[key] = function(*arguments, **named)
        return copy.deepcopy(results[key])

    return shared


def share(patch: pytest.MonkeyPatch) -> None:
    """Let all preparations share what they find."""
    for module, name in STEPS:
        patch.setattr(module, name, _once(PLAIN[name]))


def compute_anew(patch: pytest.MonkeyPatch) -> None:
    """Let every preparation find all of it itself."""
    for module, name in STEPS:
        patch.setattr(module, name, PLAIN[name])
