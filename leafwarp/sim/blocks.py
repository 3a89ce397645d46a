"""How the substeps of a frame are run: by graphs of blocks of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, repeat

# Substeps in one captured graph at most: replaying one costs next to nothing, recording it some milliseconds.
BLOCK = 32
# Substeps that share their parameters. With all of a graph, each graph would begin with a small blow.
SHARED = 8


def blocks(substeps: int) -> Iterator[int]:
    """Sizes of the graphs that so many substeps are run by: powers of two, which any count is a sum of."""
    return chain(repeat(BLOCK, substeps // BLOCK), _smaller(substeps))


def count_blocks(substeps: int) -> int:
    """How many graphs they are, however many substeps."""
    return substeps // BLOCK + len(_smaller(substeps))


def count_shares(substeps: int) -> int:
    """How many shares all blocks of so many substeps have."""
    return substeps // BLOCK * len(shares(BLOCK)) + sum(len(shares(size)) for size in _smaller(substeps))


def _smaller(substeps: int) -> list[int]:
    """The sizes after the whole blocks."""
    rest = substeps % BLOCK
    return [2**power for power in reversed(range(BLOCK.bit_length() - 1)) if rest >> power & 1]


def shares(size: int) -> list[tuple[int, float]]:
    """Substeps of each share of a block, and how many of the block's are behind in its middle."""
    return [(min(SHARED, size - start), start + 0.5 * min(SHARED, size - start)) for start in range(0, size, SHARED)]
