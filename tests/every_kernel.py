"""The kernels of the project, module by module."""

from __future__ import annotations

import importlib
import pkgutil

import warp as wp

import leafwarp_kernels
from leafwarp.sim import launch
from leafwarp.sim.launch import REAL, specialise

MODULES = sorted(module.name for module in pkgutil.iter_modules(leafwarp_kernels.__path__))


def kernels_of(name: str) -> list[wp.Kernel]:
    """The kernels of a module, each in every precision; none where it only holds what others use."""
    module = importlib.import_module(f"leafwarp_kernels.{name}")
    kernels = [v for v in vars(module).values() if isinstance(v, wp.Kernel) and v.module.name == module.__name__]
    return [specialise(kernel, precision) for kernel in kernels for precision in REAL]


def specialise_whole_modules() -> None:
    """Let this process find in the cache what the suite has compiled: every kernel of each module that it uses.

    It still loads no other module.
    """

    def whole(kernel: wp.Kernel, precision: str) -> wp.Kernel:
        kernels_of(kernel.module.name.rpartition(".")[2])
        return specialise(kernel, precision)

    launch.specialise = whole
