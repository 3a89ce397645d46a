"""What each part of a scene costs: every part can be left out, and what is saved is that part's."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from leafwarp.study.parts import PARTS, PartCost, measure_parts, parts_table

SCENES = Path(__file__).parent.parent / "scenes"
BY_NAME = {part.name: part for part in PARTS}
# Of a scene that asks for everything.
EVERYTHING = {
    "motion.wind": [0.0, 0.1, 0.0],
    "motion.settle": True,
    "shrink.plastic_set": 0.5,
    "output.contact_sheet": True,
    "mesh.vertices": 40,
    "time.frames": 5,
    "maps.size": [16, 24],
}
STAGES = {
    "gravity": {"gravity"},
    "air": {"air"},
    "curl": {"rest_angles"},
    "shrink": {"rest_lengths", "hold"},
    "bending": {"rest_angles", "angular_springs"},
    "veins in structure": {"sample_venation"},
    "source": {"source"},
    "transpiration": {"transpiration"},
    "diffusion": {"split_diffusion"},
    "display colour": {"display_color"},
    "contact sheet": {"contact_sheet"},
}


@pytest.fixture(scope="module")
def everything(small_scene: Path) -> Scene:
    return load_scene(small_scene).with_changes(EVERYTHING)


@pytest.fixture(scope="module")
def costs(everything: Scene, scene_leaf) -> dict[str, PartCost]:
    """Of a small scene that has all parts, each timed a few times."""
    return {cost.part: cost for cost in measure_parts(everything, scene_leaf, "cpu", 120.0)}


def test_every_part_of_the_scene_is_measured(costs, everything) -> None:
    assert set(costs) == {*BY_NAME, "settle", "display colour", "contact sheet", "USD output"}
    for cost in costs.values():
        assert cost.saved is not None and cost.with_part > 0.0 and cost.pairs > 0, cost
        assert cost.saved_low <= cost.saved <= cost.saved_high
        assert set(cost.stages) == STAGES.get(cost.part, set()), cost
    assert {name for name, cost in costs.items() if cost.per == "run"} == {"settle", "contact sheet"}
    assert costs["curl"].bytes > 0 and costs["diffusion"].bytes > 0 and costs["gravity"].bytes == 0


def test_what_a_part_launches_is_what_is_saved(scene_leaf, small_scene, monkeypatch) -> None:
    """With a substep count that does not depend on it, gravity is one launch a substep."""
    monkeypatch.setattr("leafwarp.study.parts.PARTS", (BY_NAME["gravity"],))
    scene = load_scene(small_scene).with_changes({"time.frames": 4, "mesh.vertices": 40, "time.fps": 1000.0})
    (gravity,) = (cost for cost in measure_parts(scene, scene_leaf) if cost.part == "gravity")
    simulation = Simulation(scene, scene_leaf(scene))
    for _ in simulation.frames():
        pass
    assert gravity.pairs == 2
    assert gravity.launches == pytest.approx(sum(simulation.substeps[1:]) / 2, abs=0.6)


def test_the_table_and_the_data_say_all(costs) -> None:
    table = parts_table(list(costs.values())).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert {row[0] for row in rows[2:]} == set(costs) and len({len(row) for row in rows}) == 1
    for name, cost in costs.items():
        data = json.loads(json.dumps(cost.as_dict()))
        assert data["part"] == name and data["saved"] == cost.saved
        assert (data["share"] is None) == (cost.without_part == 0.0)
    unmeasured = PartCost("curl", note="not measured: budget")
    assert parts_table([unmeasured]).splitlines()[-1].endswith("not measured: budget |")
    assert json.loads(json.dumps(unmeasured.as_dict()))["saved"] is None


def test_without_time_each_part_says_so(everything, scene_leaf) -> None:
    costs = measure_parts(everything, scene_leaf, "cpu", 0.0)
    assert {cost.note for cost in costs} == {"not measured: budget"}
    assert len(costs) == len(PARTS) + 4


def test_what_cannot_be_computed_without_a_part_says_why(small_scene, scene_leaf, monkeypatch) -> None:
    from leafwarp.errors import SimulationError

    scene = load_scene(small_scene).with_changes({"mesh.vertices": 40, "time.frames": 4})
    advance = Simulation.advance

    def fails_without_curl(simulation: Simulation, frame: int) -> None:
        if not simulation.scene.curls and simulation.scene.has_angular_springs:
            raise SimulationError(frame, "motion", "no; yes")
        advance(simulation, frame)

    monkeypatch.setattr(Simulation, "advance", fails_without_curl)
    monkeypatch.setattr("leafwarp.study.parts.PARTS", (BY_NAME["curl"], BY_NAME["shrink"]))
    costs = {cost.part: cost for cost in measure_parts(scene, scene_leaf, "cpu", 60.0)}
    assert costs["curl"].note == "not measured: without it, frame 2: motion: no; yes" and costs["curl"].saved is None
    assert costs["shrink"].saved is not None


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_every_shipped_scene_is_accepted_without_each_of_its_parts(name) -> None:
    scene = load_scene(SCENES / f"{name}.toml")
    there = [part for part in PARTS if part.is_there(scene)]
    assert there
    for part in there:
        reduced = part.without(scene)
        assert not part.is_there(reduced)
        assert set(reduced.map_names) <= set(scene.map_names)
        # What else is missing goes with it by its nature, and is said.
        gone = {other.name for other in there if not other.is_there(reduced)} - {part.name}
        assert gone <= {
            "air": {"wind"},
            "bending": {"curl"},
            "diffusion": {"veins in flow"},
        }.get(part.name, set()) or (gone == {"plastic set"} and part.name in ("shrink", "curl")), (part.name, gone)


def test_maps_that_nothing_else_needs_go_with_a_part(small_scene, photo) -> None:
    scene = load_scene(small_scene).with_changes({"maps.stomata": str(photo), "maps.venation": "pinnate"})
    without = BY_NAME["transpiration"].without(scene)
    assert "stomata" not in without.maps.model_fields_set and without.maps.venation == "pinnate"
    assert without.maps.shape == scene.maps.shape
