"""Substeps in blocks: which graphs run them, and how many there are."""

from __future__ import annotations

import pytest

from leafwarp.sim.blocks import BLOCK, blocks, count_blocks, count_shares, shares


@pytest.mark.parametrize("substeps", [1, 7, 8, 31, 32, 33, 100, 4096 + 21])
def test_blocks_make_up_the_substeps(substeps: int) -> None:
    sizes = list(blocks(substeps))
    assert sum(sizes) == substeps
    assert all(size <= BLOCK and size & (size - 1) == 0 for size in sizes)
    assert count_blocks(substeps) == len(sizes)
    assert count_shares(substeps) == sum(len(shares(size)) for size in sizes)
    assert sum(count for size in sizes for count, _ in shares(size)) == substeps


def test_more_substeps_than_any_memory_holds_are_counted() -> None:
    assert count_blocks(10**15 * BLOCK + 3) == 10**15 + 2
    assert count_shares(10**15 * BLOCK) == 10**15 * len(shares(BLOCK))
