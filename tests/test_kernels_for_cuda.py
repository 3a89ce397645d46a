"""Every kernel compiles for a GPU, in both precisions; the compiler comes with Warp and needs no GPU."""

from __future__ import annotations

from pathlib import Path

import pytest
import warp as wp

from every_kernel import MODULES, kernels_of

# Compute capability 7.5 (Turing), the oldest that Warp 1.19's CUDA supports.
ARCHITECTURE = 75


@pytest.mark.parametrize("name", MODULES)
def test_the_kernels_of_a_module_compile_for_a_gpu(name: str, tmp_path: Path) -> None:
    concrete = kernels_of(name)
    if not concrete:
        assert name in ("dihedral", "guards", "lanes", "sums")  # what kernels of other modules use
        return
    wp.compile_aot_module(concrete[0].module, arch=ARCHITECTURE, module_dir=tmp_path, use_ptx=True)
    (code,) = tmp_path.glob("*.ptx")
    text = code.read_text()
    for kernel in concrete:
        assert f".entry {kernel.get_mangled_name()}_cuda_kernel_forward" in text
