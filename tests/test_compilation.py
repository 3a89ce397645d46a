"""The kernels of a scene, compiled beside the preparation of its photo."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import warp as wp

import leafwarp.sim.compilation as compilation
from leafwarp.scene.file import load_scene

WAIT = 60.0  # [s] for another thread


def test_the_compiler_begins_before_all_kernels_are_found(
    small_scene: Path, device: str, precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load_scene(small_scene).with_changes({"solver.precision": precision, "output.contact_sheet": False})
    find, load = compilation.required_modules, wp.force_load
    begun, names, found = threading.Event(), [], []

    def noting(device: str, modules: list[wp.Module]) -> None:
        names.extend(module.name for module in modules)
        begun.set()
        load(device, modules)

    def finding(*arguments) -> list[wp.Module]:
        assert begun.wait(WAIT)
        found.extend(find(*arguments))
        return found

    monkeypatch.setattr(wp, "force_load", noting)
    monkeypatch.setattr(compilation, "required_modules", finding)
    with compilation.Compilation(scene, device) as compiling:
        compiling.wait()
    assert len(names) == len(set(names))
    assert set(names) == {module.name for module in found}
