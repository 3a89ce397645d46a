"""One call of the command line with the files that it reads."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

SCENES = Path(__file__).parents[2] / "scenes"
OUTPUT = "out"  # folder of the results, beside that of the files


@dataclass(frozen=True)
class Case:
    """A call of the command line.

    Attributes:
        kind: How it was made, a row of the table.
        arguments: Of the command line; paths are relative to the folder of the files.
        files: Contents of the files, by their names.
    """

    kind: str
    arguments: tuple[str, ...]
    files: Mapping[str, bytes] = field(default_factory=dict)


def damage(data: bytes, chance: random.Random, times: int) -> bytes:
    """Bytes with so many changes: a bit flipped, a byte replaced, a span removed, doubled, zeroed or moved."""
    changed = bytearray(data)
    for _ in range(times):
        if not changed:
            break
        at = chance.randrange(len(changed))
        end = min(len(changed), at + chance.choice((1, 2, 4, 16, 64)))
        span = changed[at:end]
        match chance.randrange(6):
            case 0:
                changed[at] ^= 1 << chance.randrange(8)
            case 1:
                changed[at] = chance.choice((0, 0x7F, 0x80, 0xFF, chance.randrange(256)))
            case 2:
                del changed[at:end]
            case 3:
                changed[at:at] = span
            case 4:
                changed[at:end] = bytes(len(span))
            case 5:
                del changed[at:end]
                to = chance.randrange(len(changed) + 1)
                changed[to:to] = span
    return bytes(changed)
