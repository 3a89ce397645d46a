"""What each part of a scene costs: frames with it and without it, timed in turns.

A part of the simulation is left out of the scene, everything else stays; two simulations then go through the same
frames side by side. What writes or draws a frame is timed by itself.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import warp as wp

from leafwarp.errors import InputError, SimulationError
from leafwarp.scene import Scene

if TYPE_CHECKING:
    from leafwarp.leaf.leaf import Leaf
    from leafwarp.sim.simulation import Simulation

# Pairs of frames that are timed: at most, and at least where the budget as a whole allows; frames that are written.
MOST_PAIRS, LEAST_PAIRS = 12, 3
MOST_WRITTEN = 6
# A curve of the water that does not depend on it.
FLAT = ((0.0, 1.0),)

Tables = dict[str, Any]


@dataclass(frozen=True)
class Part:
    """A part of a scene that can be left out.

    Attributes:
        name: What it is called.
        is_there: Whether a scene has it.
        leave_out: Takes it out of the tables of a scene.
        note: What has to go with it, if anything has.
    """

    name: str
    is_there: Callable[[Scene], bool]
    leave_out: Callable[[Tables, Scene], None]
    note: Callable[[Scene], str] = lambda scene: ""

    def without(self, scene: Scene) -> Scene:
        """The scene without this part, and without the maps that nothing else needs.

        Raises:
            InputError: Such a scene is not accepted.
        """
        data = scene.model_dump(exclude_unset=True)
        self.leave_out(data, scene)
        maps = data.get("maps", {})
        data["maps"] = {key: value for key, value in maps.items() if key == "size"}
        names = Scene.checked(data, scene.name).map_names
        data["maps"] = {key: value for key, value in maps.items() if key == "size" or key in names}
        return Scene.checked(data, scene.name)


@dataclass(frozen=True)
class PartCost:
    """What a part costs; None where it was not measured.

    Attributes:
        part: Its name.
        per: Whether times are those of a frame, or of something that is done once a run.
        with_part: Median wall time with it [ms].
        without_part: The same without it.
        saved: Median of the differences, pair by pair [ms].
        saved_low: Their lower quartile [ms].
        saved_high: Their upper quartile [ms].
        pairs: How many pairs were timed.
        launches: Launches a frame that are saved without it.
        bytes: Memory of arrays that is saved [byte].
        stages: Stages that are not there without it.
        note: What is left out with it, or why it was not measured.
    """

    part: str
    per: Literal["frame", "run"] = "frame"
    with_part: float | None = None
    without_part: float | None = None
    saved: float | None = None
    saved_low: float | None = None
    saved_high: float | None = None
    pairs: int = 0
    launches: float | None = None
    bytes: int | None = None
    stages: tuple[str, ...] = ()
    note: str = ""

    @property
    def share(self) -> float | None:
        """What is saved, over the time with it; None where it was timed by itself, or not at all."""
        return self.saved / self.with_part if self.with_part and self.without_part else None

    @property
    def is_clear(self) -> bool:
        """Whether there are enough pairs, and the middle half of their differences is on one side of 0."""
        return self.pairs >= LEAST_PAIRS and (self.saved_low > 0.0 or self.saved_high < 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self) | {"stages": list(self.stages), "share": self.share, "is_clear": self.is_clear}


def _drop(*tables: str) -> Callable[[Tables, Scene], None]:
    def leave_out(data: Tables, scene: Scene) -> None:
        for name in tables:
            data.pop(name, None)

    return leave_out


def _put(values: Mapping[str, Any]) -> Callable[[Tables, Scene], None]:
    """Values by dotted keys, in tables that the scene has anyway."""

    def leave_out(data: Tables, scene: Scene) -> None:
        for key, value in values.items():
            table, _, name = key.partition(".")
            data.setdefault(table, {})[name] = value

    return leave_out


def _without_load(*keys: str) -> Callable[[Tables, Scene], None]:
    """Without a load; nothing settles where there is no other."""

    def leave_out(data: Tables, scene: Scene) -> None:
        motion = data["motion"]
        for key in keys:
            motion.pop(key, None)
        if motion.get("wind") is None and not any(motion.get("gravity") or ()):
            motion.pop("settle", None)

    return leave_out


def _without_air(data: Tables, scene: Scene) -> None:
    _put({"motion.drag": 0.0})(data, scene)
    _without_load("wind")(data, scene)


def _without_curl(data: Tables, scene: Scene) -> None:
    data.pop("curl", None)
    if scene.material is not None:
        data["material"]["mismatch"] = 0.0


def _without_shrink(data: Tables, scene: Scene) -> None:
    data.pop("shrink", None)
    if scene.material is not None:
        data["material"] |= {"shrink_across": 0.0, "shrink_along": 0.0}


def _without_bending(data: Tables, scene: Scene) -> None:
    _without_curl(data, scene)
    _put({"structure.bending_stiffness": 0.0})(data, scene)


def _without_veins_in_structure(data: Tables, scene: Scene) -> None:
    _put({"structure.vein_stiffness": 1.0, "structure.vein_bending_stiffness": 1.0})(data, scene)
    if scene.shrink is not None:
        _put({"shrink.vein_resistance": 0.0, "shrink.along_veins": 1.0})(data, scene)
    if scene.curl is not None:
        _put({"curl.vein_resistance": 0.0})(data, scene)


def _without_set(data: Tables, scene: Scene) -> None:
    for table in ("shrink", "curl"):
        if getattr(scene, table) is not None:
            _put({f"{table}.plastic_set": 0.0})(data, scene)


def _without_veins_in_flow(data: Tables, scene: Scene) -> None:
    data["fluid"]["vein_diffusivity"] = data["fluid"]["lamina_diffusivity"] = scene.fluid.lamina_diffusivity


def _transpires(scene: Scene) -> bool:
    return scene.transpiration is not None and scene.transpiration.rate > 0.0


def _is_fed(scene: Scene) -> bool:
    return scene.source is not None and scene.source.conductance > 0.0


def _settles_no_more(*loads: str) -> Callable[[Scene], str]:
    """Which other load there is, if the leaf settles."""

    def note(scene: Scene) -> str:
        others = {"gravity": scene.has_weight, "wind": scene.motion.wind is not None}
        left = any(there for name, there in others.items() if name not in loads)
        return "with motion.settle, which needs a load" if scene.motion.settle and not left else ""

    return note


# Parts of the simulation, each a change of the scene.
PARTS: tuple[Part, ...] = (
    Part("gravity", lambda s: s.has_weight, _without_load("gravity"), _settles_no_more("gravity")),
    Part("wind", lambda s: s.motion.wind is not None, _without_load("wind"), _settles_no_more("wind")),
    Part("air", lambda s: s.motion.drag > 0.0, _without_air,
         lambda s: "with motion.wind, which needs its drag" if s.motion.wind is not None else ""),
    Part("curl", lambda s: s.curls, _without_curl),
    Part("shrink", lambda s: s.shrinks, _without_shrink),
    Part("bending", lambda s: s.has_angular_springs, _without_bending,
         lambda s: "with [curl], which needs it" if s.curl is not None else ""),
    Part("veins in flow", lambda s: s.flow_has_veins, _without_veins_in_flow),
    Part("veins in structure", lambda s: s.structure_has_veins or s.shrinks_along_veins, _without_veins_in_structure),
    Part("source", _is_fed, _drop("source")),
    Part("transpiration", _transpires, _drop("transpiration", "air", "stomata")),
    Part("diffusion", lambda s: s.water_flows, _put({"fluid.lamina_diffusivity": 0.0, "fluid.vein_diffusivity": 0.0})),
    Part("stiffness curve", lambda s: s.stiffness_varies,
         _put({"structure.stiffness": FLAT, "structure.wilting": FLAT, "structure.drying": FLAT})),
    Part("plastic set", lambda s: s.keeps_a_set, _without_set),
)  # fmt: skip


def measure_parts(
    scene: Scene, leaf_of: Callable[[Scene], Leaf], device: str = "cpu", budget: float = 60.0
) -> list[PartCost]:
    """What each part that a scene has costs.

    Args:
        scene: The scene.
        leaf_of: Gives its leaf, which serves the scenes without a part, too.
        device: Warp device.
        budget: Wall time [s] once there is the leaf; what is under way when it ends is done once. Parts for which no
            time is left are listed with a note.

    Raises:
        SimulationError: The scene itself cannot be computed.
    """
    leaf = leaf_of(scene)
    end = time.perf_counter() + budget
    plain = scene.with_changes({"output.contact_sheet": False, "output.display_color": False})
    _simulation(plain, leaf, device)  # loads the kernels
    costs: list[PartCost] = []
    measures = list(_measures(scene, plain, leaf, device))
    for index, (name, measure) in enumerate(measures):
        now = time.perf_counter()
        if now >= end:
            costs.append(PartCost(name, note="not measured: budget"))
            continue
        try:
            costs.append(measure(_Time(now + (end - now) / (len(measures) - index), end)))
        except SimulationError as error:
            costs.append(PartCost(name, note=f"not measured: without it, {error}"))
    return costs


@dataclass(frozen=True)
class _Time:
    """Readings of ``time.perf_counter``: until when a part may be measured, and when all is to end."""

    until: float
    end: float

    def allows(self, done: int, least: int = LEAST_PAIRS, most: int = MOST_PAIRS) -> bool:
        """Whether to measure once more after so many times."""
        return done == 0 or (done < most and time.perf_counter() < (self.end if done < least else self.until))


def _measures(scene: Scene, plain: Scene, leaf: Leaf, device: str) -> Iterator[tuple[str, Callable[[_Time], PartCost]]]:
    """The parts of a scene by name, each with what measures it in a time; what takes little of it comes first."""
    yield "USD output", lambda allowed: _measure_usd(scene, leaf, device, allowed)
    if scene.output.display_color:
        yield "display colour", lambda allowed: _measure_color(scene, leaf, device, allowed)
    if scene.output.contact_sheet:
        yield "contact sheet", lambda allowed: _measure_contact_sheet(scene, leaf, device, allowed)
    for part in PARTS:
        if part.is_there(scene):
            yield part.name, lambda allowed, part=part: _measure_part(part, plain, leaf, device, allowed)
    if scene.motion.settle:
        yield "settle", lambda allowed: _measure_settling(plain, leaf, device, allowed)


def _simulation(scene: Scene, leaf: Leaf, device: str) -> Simulation:
    """A simulation that has come to frame 2, so that all its kernels and graphs are there."""
    from leafwarp.sim.simulation import Simulation

    simulation = Simulation(scene, leaf, device)
    if scene.motion.method == "quasistatic":
        simulation.settle()
    _next_frame(simulation, 2)
    return simulation


def _next_frame(simulation: Simulation, frame: int) -> float:
    """Compute and read a frame; the wall time that it takes [ms]."""
    begin = time.perf_counter()
    if frame <= simulation.scene.time.frames:
        simulation.advance(frame)
    simulation.read_frame(frame)
    wp.synchronize_device(simulation.state.device)
    return 1e3 * (time.perf_counter() - begin)


def _measure_part(part: Part, scene: Scene, leaf: Leaf, device: str, allowed: _Time) -> PartCost:
    note = part.note(scene)
    try:
        reduced = part.without(scene)
    except InputError as error:
        return PartCost(part.name, note=f"cannot be left out alone: {error}")
    # Before the first frame both would come to rest; what that costs is a part of its own.
    both = [each.with_changes({"motion.settle": False}) for each in (scene, reduced)]
    full, without = (_simulation(each, leaf, device) for each in both)
    launched = [simulation.state.launch_count for simulation in (full, without)]
    laps: tuple[list[float], list[float]] = ([], [])
    frames = range(3, min(scene.time.frames, 2 + MOST_PAIRS) + 1)
    for frame in frames:
        if not allowed.allows(len(laps[0])):
            break
        order = (0, 1) if frame % 2 else (1, 0)
        for side in order:
            laps[side].append(_next_frame((full, without)[side], frame))
    if not laps[0]:
        return PartCost(part.name, note="not measured: a film of fewer than 3 frames")
    counts = [
        (simulation.state.launch_count - before) / len(laps[0])
        for simulation, before in zip((full, without), launched, strict=True)
    ]
    names = {stage.name for stage in without.plan.stages}
    return _cost(
        part.name,
        *laps,
        launches=counts[0] - counts[1],
        bytes=full.plan.byte_count - without.plan.byte_count,
        stages=tuple(stage.name for stage in full.plan.stages if stage.name not in names),
        note=note,
    )


def _cost(name: str, with_part: Sequence[float], without_part: Sequence[float], **facts: Any) -> PartCost:
    """The cost that follows from laps in turns [ms]."""
    saved = [a - b for a, b in zip(with_part, without_part, strict=True)]
    low, middle, high = statistics.quantiles(saved, n=4, method="inclusive") if len(saved) > 1 else 3 * saved
    return PartCost(
        name,
        with_part=statistics.median(with_part),
        without_part=statistics.median(without_part),
        saved=middle,
        saved_low=low,
        saved_high=high,
        pairs=len(saved),
        **facts,
    )


def _measure_settling(scene: Scene, leaf: Leaf, device: str, allowed: _Time) -> PartCost:
    from leafwarp.sim.simulation import Simulation

    if scene.motion.method == "quasistatic":
        return PartCost("settle", "run", note="cannot be left out: every frame of quasistatic motion is at rest")
    laps = []
    while allowed.allows(len(laps), least=1, most=LEAST_PAIRS):
        simulation = Simulation(scene, leaf, device)
        before = simulation.state.launch_count
        laps.append(_timed(simulation.settle))
    launches = simulation.state.launch_count - before
    return _cost("settle", laps, [0.0] * len(laps), per="run", launches=launches, bytes=0)


def _timed(work: Callable[[], object]) -> float:
    """Wall time of something [ms]."""
    begin = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - begin)


def _measure_color(scene: Scene, leaf: Leaf, device: str, allowed: _Time) -> PartCost:
    from leafwarp.sim.simulation import Simulation

    simulation = Simulation(scene, leaf, device)
    frame, stage = simulation.read_frame(1), simulation.stage("display_color")
    laps: list[float] = []
    while allowed.allows(len(laps)):
        laps.append(_timed(lambda: stage.color(frame)))
    return _cost("display colour", laps, [0.0] * len(laps), launches=0.0, bytes=0, stages=(stage.name,))


def _measure_contact_sheet(scene: Scene, leaf: Leaf, device: str, allowed: _Time) -> PartCost:
    """The picture of a single moment."""
    from leafwarp.sim.simulation import Simulation

    simulation = Simulation(scene, leaf, device)
    sheet = simulation.stage("contact_sheet")
    frame = simulation.read_frame(1)
    laps = []
    with tempfile.TemporaryDirectory() as folder:

        def draw() -> None:
            sheet.start(frame.index, frame.index)
            sheet.capture(frame)
            sheet.save(Path(folder) / "sheet.png")

        draw()  # loads the kernels
        while allowed.allows(len(laps), least=1, most=LEAST_PAIRS):
            laps.append(_timed(draw))
    note = "one moment; a film has up to 8"
    return _cost("contact sheet", laps, [0.0] * len(laps), per="run", bytes=0, stages=(sheet.name,), note=note)


def _measure_usd(scene: Scene, leaf: Leaf, device: str, allowed: _Time) -> PartCost:
    """Frames, as many as there is time for, written and merged."""
    import dataclasses

    from leafwarp.sim.simulation import Simulation
    from leafwarp.usd.writer import UsdWriter

    simulation = Simulation(scene, leaf, device)
    rest = simulation.read_frame(0)
    frames = range(1, MOST_WRITTEN + 1)
    laps = []
    with tempfile.TemporaryDirectory() as folder:
        output = scene.output
        writer = UsdWriter(Path(folder) / "parts.usd", leaf, rest, frames=frames, fps=scene.time.fps,
                           display_color=output.display_color, up_axis=output.up_axis)  # fmt: skip
        for index in frames:
            if not allowed.allows(len(laps)):
                break
            frame = dataclasses.replace(rest, index=index)
            laps.append(_timed(lambda frame=frame: writer.write(frame)))
        merged = _timed(writer.close) / len(laps)
    note = "cannot be left out of a run"
    return _cost("USD output", [lap + merged for lap in laps], [0.0] * len(laps), launches=0.0, bytes=0, note=note)


def parts_table(costs: Sequence[PartCost]) -> str:
    """The costs as a table in Markdown, the dearest first."""
    rows = [
        "| part | per | with it [ms] | without [ms] | saved [ms] (middle half) | share | launches | kB | stages |",
        "|---|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    for cost in sorted(costs, key=lambda cost: (cost.saved is None, cost.per, -(cost.saved or 0.0))):
        stages = ", ".join(cost.stages)
        unclear = "lost in the noise" if cost.without_part and not cost.is_clear else ""
        notes = "; ".join(text for text in (stages, cost.note, unclear) if text)
        if cost.saved is None:
            rows.append(f"| {cost.part} | {cost.per} | | | | | | | {notes} |")
            continue
        spread = f"{cost.saved:.3g} ({cost.saved_low:.3g} to {cost.saved_high:.3g})"
        launches = "" if cost.launches is None else f"{cost.launches:.4g}"
        kilobytes = "" if cost.bytes is None else f"{cost.bytes / 1e3:.4g}"
        rows.append(
            f"| {cost.part} | {cost.per} | {cost.with_part:.3g} | {cost.without_part:.3g} | {spread} | "
            f"{'' if cost.share is None else f'{cost.share:.0%}'} | {launches} | {kilobytes} | {notes} |"
        )
    return "\n".join(rows)
