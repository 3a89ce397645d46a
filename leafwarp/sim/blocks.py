"""How the substeps of a frame are run: by graphs of blocks of them."""

from __future__ import annotations

# Substeps in one captured graph at most: replaying one costs next to nothing, recording it some milliseconds.
BLOCK = 32
# Substeps that share their parameters. With all of a graph, each graph would begin with a small blow.
SHARED = 8


def blocks(substeps: int) -> list[int]:
    """Sizes of the graphs that so many substeps are run by: powers of two, which any count is a sum of."""
    rest = substeps % BLOCK
    smaller = [2**power for power in reversed(range(BLOCK.bit_length() - 1)) if rest >> power & 1]
    return [BLOCK] * (substeps // BLOCK) + smaller


def shares(size: int) -> list[tuple[int, float]]:
    """Substeps of each share of a block, and how many of the block's are behind in its middle."""
    return [(min(SHARED, size - start), start + 0.5 * min(SHARED, size - start)) for start in range(0, size, SHARED)]
