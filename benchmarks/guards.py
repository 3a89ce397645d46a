"""Guards: what the checks of water, structure and frames cost, as a share of a frame of the bramble leaf.

The same simulation runs twice in turns: as it is, and with kernels of whose source the checks were taken out.
"""

from __future__ import annotations

import argparse
import importlib.util
import inspect
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from unittest import mock

from benchmarks.timing import Timing, round_robin
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene.file import load_scene
from leafwarp.sim import stable_step as stable_step_stage
from leafwarp.sim.fluid import water as water_stage
from leafwarp.sim.fluid.controller import Fluid
from leafwarp.sim.output import FrameOutput
from leafwarp.sim.simulation import Simulation
from leafwarp_kernels import interpolation, stable_step

TITLE = "Guards"
QUICK = "64 x 64 cells alone"
ROUNDS = (15, 2)
SCENE = Path(__file__).parent.parent / "scenes" / "bramble.toml"
SIZES = (256, 1024)
OPTIONS: dict[str, dict] = {}
# What is taken out of the kernels' sources, and what is put in its place.
BLEND_CHECK = re.compile(r"    outside = wp\.int32\(0\)\n.*?sign_out\[WRONG\] = look\n", re.DOTALL)
GUARD_CALL = re.compile(r"\b(?:non_negative|positive)\(([^()]*)\)|\bif_finite\((reachable\([^()]*\)), [^()]*\)")
# Parts are measured so many times as often as frames, each for so short that other work seldom comes between.
PART_ROUNDS, PART_LAP = 20, 3e-4  # [s]
# How often a frame does each of what is checked.
TIMES_A_FRAME = {"water": 1, "frequencies": 2, "stretch": 2, "frame": 1}


def unguarded(module: ModuleType, pattern: re.Pattern, folder: Path) -> ModuleType:
    """A module of kernels without its checks."""
    source, count = pattern.subn(lambda found: found.group(1) or found.group(2) if found.groups() else "",
                                 inspect.getsource(module))  # fmt: skip
    if count == 0:
        raise LookupError(f"{module.__name__}: no check was found to take out")
    path = folder / f"unguarded_{module.__name__.rpartition('.')[2]}.py"
    path.write_text(source, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    return copy


@contextmanager
def without_guards() -> Iterator[None]:
    """Simulations that are made within have no guards."""
    with tempfile.TemporaryDirectory() as folder:
        blend = unguarded(interpolation, BLEND_CHECK, Path(folder))
        bounds = unguarded(stable_step, GUARD_CALL, Path(folder))
        with (
            mock.patch.object(water_stage, "interpolate_water", blend.interpolate_water),
            mock.patch.object(stable_step_stage, "stable_step", bounds),
        ):
            yield


class Contender:
    """A simulation whose frames are timed one by one, or parts of them."""

    def __init__(self, simulation: Simulation, is_guarded: bool):
        self.simulation, self._is_guarded = simulation, is_guarded
        self._frame = 1
        self.advance()

    def advance(self) -> None:
        """Compute and read the next frame."""
        self._frame += 1
        if self._is_guarded:
            self.simulation.advance(self._frame)
            self.shown = self.simulation.read_frame(self._frame)
        else:
            with mock.patch.object(Fluid, "check"), mock.patch.object(FrameOutput, "check"):
                self.simulation.advance(self._frame)
                self.shown = self.simulation.read_frame(self._frame)

    def parts(self) -> dict[str, Callable[[], object]]:
        """What is checked: the work that a check is part of."""
        stages = {stage.name: stage for stage in self.simulation.plan.stages}

        def check_frame() -> None:
            if self._is_guarded:
                self.simulation.fluid.check(self._frame)
                stages["frame"].check(self.shown)

        return {
            "water": lambda: stages["water"].blend(0.5),
            "frequencies": stages["stable_step"].largest_squared_frequency,
            "stretch": stages["stable_step"].largest_stretch,
            "frame": check_frame,
        }


def measure(size: int, device: str, rounds: int) -> tuple[Timing, Timing, dict[str, Timing]]:
    """Time of a frame [ms], that of a guarded frame over it, and what the guards of each part add to a frame [ms]."""
    scene = load_scene(SCENE).with_changes({"maps.size": size, "output.contact_sheet": False})
    leaf = prepare_scene_leaf(scene, None)
    with without_guards():
        bare = Contender(Simulation(scene, leaf, device), False)
    contenders = {"guarded": Contender(Simulation(scene, leaf, device), True), "bare": bare}
    frames = round_robin({name: contender.advance for name, contender in contenders.items()}, rounds, 0.0)
    added = {}
    for part, times in TIMES_A_FRAME.items():
        work = {name: contender.parts()[part] for name, contender in contenders.items()}
        laps = round_robin(work, PART_ROUNDS * rounds, PART_LAP)
        pairs = zip(laps["guarded"].values, laps["bare"].values, strict=True)
        added[part] = Timing(tuple(times * (guarded - without) for guarded, without in pairs))
    return frames["bare"], frames["guarded"].over(frames["bare"]), added


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    rows = [
        f"| map | frame without guards [ms] | {' | '.join(f'{part} [us]' for part in TIMES_A_FRAME)} | "
        "all guards [% of the frame] | whole frames, with over without |",
        "|---:|---:|" + len(TIMES_A_FRAME) * "---:|" + "---:|---:|",
    ]
    for size in (64,) if options.quick else SIZES:
        frame, ratio, added = measure(size, options.device, options.rounds)
        total = sum((timing for timing in list(added.values())[1:]), start=next(iter(added.values())))
        share = Timing(tuple(100.0 * value / frame.median for value in total.values))
        each = " | ".join(str(Timing(tuple(1e3 * value for value in timing.values))) for timing in added.values())
        rows.append(f"| {size}^2 | {frame} | {each} | {share} | {ratio} |")
    return (
        "What the guards add to a frame of `scenes/bramble.toml`: median, and the range of the middle half of "
        f"{options.rounds} frames, and of {PART_ROUNDS * options.rounds} times each part, in turns with the same work "
        "without them.\n\n" + "\n".join(rows)
    )
