"""The kernels of a scene, compiled while its photo is still being prepared.

Warp compiles a module of kernels as one, again each time a further kernel of it is asked for. All kernels of a scene
are therefore found first, by binding its stages to a leaf of six triangles without running any; then each module is
compiled once, in a thread beside the preparation of the photo.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp

from leafwarp.leaf.leaf import Leaf, MapFrame
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.scene import Scene
from leafwarp.sim.launch import ArraySpec, Command, State, specialise
from leafwarp.sim.plan import make_plan
from leafwarp.sim.stage import bind_stage
from leafwarp_kernels.normals import vertex_normals


class _Unrun:
    """A launch that is never made."""

    def launch(self) -> None:
        pass


class _Rehearsal(State):
    """Arrays whose recorded kernels are noted, and neither compiled nor launched."""

    def __init__(self, specs: Iterable[ArraySpec], device: str, precision: str):
        super().__init__(specs, device, precision)
        self.modules: dict[wp.Module, None] = {}  # in the order of their first kernels

    def record(
        self, kernel: wp.Kernel, dim: int | Sequence[int], inputs: Sequence[Any], outputs: Sequence[Any]
    ) -> Command:
        self.modules[specialise(kernel, self.precision).module] = None
        return Command(self, _Unrun(), kernel.key, (), ())


def _smallest_leaf(scene: Scene) -> Leaf:
    """A hexagon 2 cm across, all of its maps 1."""
    angles = np.radians(60.0 * np.arange(6))
    rim = np.stack([1.0 + np.cos(angles), np.sin(angles)], axis=1)
    positions = 0.01 * np.concatenate([rim, [[1.0, 0.0]]])
    triangles = np.array([[corner, (corner + 1) % 6, 6] for corner in range(6)])
    shape = (8, 8)
    return Leaf(
        mesh=mesh_from_triangles(positions, triangles),
        frame=MapFrame((-0.001, -0.01), (0.022, 0.02)),
        length=0.02,
        texture=np.zeros((*shape, 3), np.uint8),
        mask=np.ones(shape, bool) if scene.map_names else None,
        maps={name: np.ones(shape) for name in scene.map_names},
    )


def required_modules(scene: Scene, device: str) -> list[wp.Module]:
    """The modules of the kernels that the stages of a scene launch, each specialised for them, none compiled.

    Args:
        scene: The scene.
        device: Warp device.
    """
    # A radius given for a real leaf would hold the whole of this one.
    scene = scene.model_copy(update={"motion": scene.motion.model_copy(update={"pin_radius": None})})
    plan = make_plan(scene, _smallest_leaf(scene))
    state = _Rehearsal(plan.arrays, device, scene.solver.precision)
    for group in ("fluid", "motion", "coupling", "output"):
        for stage in plan.groups[group]:
            bind_stage(stage, state)
    return list(state.modules)


class Compilation:
    """Compiles and loads the modules of a scene in a thread.

    Args:
        scene: The scene.
        device: Warp device.
    """

    def __init__(self, scene: Scene, device: str):
        self._device = device
        # Two threads that find Warp not yet initialised would both do so, and modules being compiled would change.
        wp.init()
        # One thread: the compiler reads its headers once a thread, which takes longer than most modules. So it begins
        # with a kernel that every scene has, before the others are found.
        self._pool = ThreadPoolExecutor(1)
        first = specialise(vertex_normals, scene.solver.precision).module
        self._needed = [self._start(first)]
        self._needed += [self._start(module) for module in required_modules(scene, device) if module is not first]
        self._last: list[Future] = []
        if scene.output.contact_sheet:
            from leafwarp_kernels import raycast

            self._last.append(self._start(wp.get_module(raycast.__name__)))

    def _start(self, module: wp.Module) -> Future:
        return self._pool.submit(wp.force_load, self._device, [module])

    def wait(self) -> None:
        """Wait until the modules that a frame needs are loaded."""
        for loading in self._needed:
            loading.result()

    def finish(self) -> None:
        """Wait for those of the contact sheet, too."""
        for loading in self._last:
            loading.result()

    def __enter__(self) -> Compilation:
        return self

    def __exit__(self, *failure: object) -> None:
        # After a failure nothing that has not begun is compiled any more.
        self._pool.shutdown(wait=False, cancel_futures=True)
