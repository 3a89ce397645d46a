"""Vectors whose components go through the same arithmetic side by side: the lanes of a CPU's vector unit.

On a CPU Warp runs a launch on one core, one thread after another, and what a thread does with scalars stays scalar.
What it does with a vector of this length is compiled to vector instructions: 32 lines, or springs, for little more than
the price of one or two. (Shorter vectors are unrolled too early to be found again, longer ones spill.) A GPU does the
same with neighbouring threads; the scalar kernels are for it.

A block is 32 neighbours. What is kept for each of them lies block by block, in an array of such vectors.
"""

import warp as wp

LANES = 32

Lanes = wp.types.vector(length=LANES, dtype=wp.Float)
