"""Whatever a valid scene says, it ends with finite frames or with a line that says where and why, and what helps.

``LEAFWARP_SCENES=2000`` in the environment draws as many scenes, other ones in every run.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, event, given, settings
from hypothesis import strategies as st
from pxr import Usd, UsdGeom

from leafwarp.errors import SimulationError
from leafwarp.run import output_paths, run_scene
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import Resolution
from leafwarp.sim.limits import FARTHEST_TRAVEL
from leafwarp.sim.pace import couplings_per_frame
from leafwarp.sim.simulation import Simulation
from leafwarp.study.tolerance import Choice, Search
from scene_strategies import scenes, small_resolution

SCENES = os.environ.get("LEAFWARP_SCENES")  # to draw
FEW = 30  # where nothing is said
TIME_LIMIT = 60.0  # [s] of a scene; most take a tenth of a second
FINEST_LEVEL = 4  # of a scene with a tolerance
COARSE = "coarse film for tolerance: "  # before the stage of what fails there
SETTLING = 2**12  # substeps; the 2**17 that are allowed take seconds
# Of the water, over all that was there, came and went: rounding of every step's account.
ROUNDING = {"float32": 1e-6, "float64": 1e-13}
# What is left of a line once the frame is named: where, what is wrong, and the keys to change.
LINE = re.compile(r"frame (\d+): (?P<stage>[a-z][a-z_ ]+): (?P<quantity>[^;]*[^; ]); (?P<remedy>.+)")
STAGES = {"motion", "settling", "implicit_motion", "quasistatic_motion", "unsplit_diffusion", "factored_diffusion"}
STAGES |= {"half_steps"}
KEYS = re.compile(r"(leaf|fluid|source|shrink|curl|structure|motion|solver|time|maps|mesh)\.(\w+)|load|curl|stiffness")


def random_scenes(share: float) -> settings:
    """A share of the scenes asked for. None is made simpler after a failure: that takes longer than to read one."""
    return settings(
        max_examples=max(1, round(share * int(SCENES or FEW))),
        derandomize=SCENES is None,
        database=None,
        deadline=None,
        print_blob=True,
        phases=[Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture],
    )


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Break off what takes longer."""

    def late(*_: object) -> None:
        raise TimeoutError(f"no end after {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> str:
    pixels = np.full((96, 64, 3), 235, np.uint8)
    cv2.ellipse(pixels, (32, 40), (20, 32), 0, 0, 360, (60, 140, 70), -1, cv2.LINE_AA)
    cv2.line(pixels, (32, 60), (32, 88), (60, 130, 80), 3, cv2.LINE_AA)
    cv2.line(pixels, (32, 86), (32, 14), (120, 190, 150), 2, cv2.LINE_AA)
    path = tmp_path_factory.mktemp("properties") / "leaf.png"
    cv2.imwrite(str(path), pixels)
    return str(path)


@pytest.fixture
def short_settling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("leafwarp.sim.motion.SETTLING_SUBSTEPS", SETTLING)


@pytest.fixture
def small_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a quality or a tolerance decides is coarser than in the product, of a first film always the coarsest."""
    first = Search.first

    def coarsest(search: Search) -> Choice:
        choice = first(search)
        return search._choice(0, choice.expected, choice.level)

    monkeypatch.setattr(Resolution, "of", staticmethod(small_resolution))
    monkeypatch.setattr("leafwarp.study.tolerance.HIGHEST_LEVEL", FINEST_LEVEL)
    monkeypatch.setattr(Search, "first", coarsest)


def wettest(simulation: Simulation) -> float:
    """The largest water content that a leaf can have: that at the start, or that of its supply."""
    scene = simulation.scene
    if scene.fluid is None:
        return max(water for _, water in scene.water.curve)
    supply = 0.0 if scene.source is None else scene.source.supply
    return max(supply, float(simulation.state["water"].numpy().max()))


def check_frames(simulation: Simulation) -> None:
    """Compute all frames: each is finite, its water within what there was, and no vertex far from where it was."""
    scene, leaf = simulation.scene, simulation.leaf
    length = leaf.length * max(specimen.size for specimen in leaf.specimens)
    most = wettest(simulation)
    rounding = 1e-5 if scene.fluid is None or scene.fluid.scheme == "split" else 1e-5 + 2.0 * scene.fluid.tolerance
    before, count = None, 0
    for frame in simulation.frames():
        count += 1
        for name in ("points", "normals", "velocities", "water"):
            assert np.isfinite(getattr(frame, name)).all(), (frame.index, name)
        assert -rounding <= frame.water.min() and frame.water.max() <= most + rounding, frame.index
        if before is not None:
            travel = np.linalg.norm(frame.points - before.points, axis=1).max()
            spans = sum(moment.on_path + (moment.share > 0.0) for moment in simulation.moments(frame.index))
            assert travel <= FARTHEST_TRAVEL * length * spans * (1.0 + 1e-5), frame.index
        before = frame
    assert count == scene.time.frames


def check_ledger(simulation: Simulation) -> None:
    """What became of the water is known but for rounding, and for the error that the scene allows an unsplit step."""
    ledger, scene = simulation.fluid.ledger(), simulation.scene
    turnover = ledger.start + abs(ledger.added) + ledger.transpired
    allowed = ROUNDING[scene.solver.precision]
    if scene.fluid.scheme == "unsplit":
        allowed += scene.residual_tolerance * simulation.fluid.steps_done
    assert abs(ledger.error) <= allowed * turnover, ledger


def check_line(error: SimulationError, scene: Scene) -> None:
    """A failure names its frame, its stage, what is wrong, and what would help."""
    line = LINE.fullmatch(str(error).replace(COARSE, "", 1))
    assert line is not None, error
    assert 0 <= error.frame <= scene.time.frames and error.frame == int(line[1])
    assert line["stage"] == error.stage.removeprefix(COARSE) in STAGES, error
    assert re.search(r"\d|finite|short enough|potential|factor|nan|inf", line["quantity"]), error
    assert KEYS.search(line["remedy"]), error


@random_scenes(1.0)
@given(data=st.data())
def test_a_scene_ends_with_finite_frames_or_a_line_that_helps(
    picture: str, scene_leaf, short_settling: None, small_levels: None, data: st.DataObject
) -> None:
    scene = data.draw(scenes(picture))
    with time_limit(TIME_LIMIT):
        try:
            simulation = Simulation(scene, scene_leaf(scene))
            check_frames(simulation)
        except SimulationError as error:
            event(f"{scene.motion.method}: fails")
            check_line(error, scene)
        else:
            event(f"{scene.motion.method}: done")
            if simulation.fluid is not None:
                check_ledger(simulation)


def check_tolerance(found: dict) -> None:
    """The film that was kept has an error that is known; where a finer one failed, a line says why."""
    event(f"with a tolerance: {len(found['passes'])} films, {'a finer one fails' if found['failure'] else 'done'}")
    assert 0.0 <= found["reached"] < math.inf
    assert found["failure"] is None or LINE.fullmatch(found["failure"].replace(COARSE, "", 1)), found


def frames_of(path: Path) -> list[np.ndarray]:
    """Points of the first leaf of every frame of a USD."""
    stage = Usd.Stage.Open(str(path))
    points = next(UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)).GetPointsAttr()
    return [np.array(points.Get(time)) for time in points.GetTimeSamples()]


@random_scenes(0.2)
@given(data=st.data())
def test_a_run_keeps_the_frames_before_a_failure(
    picture: str, short_settling: None, small_levels: None, prepared_folder: Path, data: st.DataObject
) -> None:
    scene = data.draw(scenes(picture))
    paths = output_paths(scene, prepared_folder)
    expected = scene.time.frames
    with time_limit(TIME_LIMIT):
        try:
            report = run_scene(scene, paths, overwrite=True, progress_level=-1)
            if scene.tolerance is not None:
                check_tolerance(report["tolerance"])
        except SimulationError as error:
            check_line(error, scene)
            if error.stage.startswith(COARSE):
                event("fails in a coarse film")
                return
            expected = max(0, error.frame - 1)
            event("fails in settling" if error.frame == 0 else "fails in a frame")
    kept = frames_of(paths.usd)
    assert len(kept) == expected
    assert all(np.isfinite(points).all() for points in kept)
    assert paths.report.is_file()


def test_a_jump_of_the_shrinking_where_no_water_is_lost(small_scene: Path) -> None:
    changes = ["transpiration.rate=0", "transpiration.cuticle_rate=0", "source.conductance=0", "time.frames=2"]
    scene = load_scene(small_scene, ["shrink.curve=[[0, 0.2], [5e-324, 0], [1, 0]]", *changes])
    assert couplings_per_frame(scene) == 1
