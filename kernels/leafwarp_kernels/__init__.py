"""Warp kernels of leafwarp, one subject a file: arrays in, arrays out, no allocation and no scene."""
