"""Every kernel compiles for a GPU, in both precisions; the compiler comes with Warp and needs no GPU."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
import warp as wp

import leafwarp_kernels
from leafwarp.sim.launch import specialise

# Compute capability 7.5 (Turing), the oldest that Warp 1.19's CUDA supports.
ARCHITECTURE = 75
MODULES = sorted(module.name for module in pkgutil.iter_modules(leafwarp_kernels.__path__))


@pytest.mark.parametrize("name", MODULES)
def test_the_kernels_of_a_module_compile_for_a_gpu(name: str, tmp_path: Path) -> None:
    module = importlib.import_module(f"leafwarp_kernels.{name}")
    kernels = [
        value
        for value in vars(module).values()
        if isinstance(value, wp.Kernel) and value.module.name == module.__name__
    ]
    if not kernels:
        assert name in ("dihedral", "lanes")  # what kernels of other modules use
        return
    concrete = [specialise(kernel, precision) for kernel in kernels for precision in ("float32", "float64")]
    wp.compile_aot_module(module, arch=ARCHITECTURE, module_dir=tmp_path, use_ptx=True)
    (code,) = tmp_path.glob("*.ptx")
    text = code.read_text()
    for kernel in concrete:
        assert f".entry {kernel.get_mangled_name()}_cuda_kernel_forward" in text
