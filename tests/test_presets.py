"""The committed table of the presets belongs to the presets of the code, and none is beaten in it."""

from __future__ import annotations

import json
from itertools import pairwise

from benchmarks.presets import BETTER, KEPT, beating, can_be_judged
from leafwarp.scene.quality import QUALITIES, Resolution


def test_the_committed_table_is_of_these_presets() -> None:
    found = json.loads(KEPT.read_text())
    assert {one["quality"] for one in found} == set(QUALITIES)
    for one in found:
        wanted = Resolution.of(QUALITIES[one["quality"]])
        assert one["cells"] in (None, wanted.cells) and one["fluid_steps"] in (None, wanted.fluid_steps)
        assert one["compared_with"] >= 10
        assert all(by["time"] < BETTER for by in one["beaten_by"])


def test_what_beats_a_preset_in_it_is_told() -> None:
    page = KEPT.with_name("CHOOSING.md").read_text()
    for one in json.loads(KEPT.read_text()):
        for by in one["beaten_by"]:
            assert f'`{one["scene"]}`, `"{one["quality"]}"`: `{by["varied"]}`' in page


def test_finer_presets_are_slower_and_no_further_off() -> None:
    found = json.loads(KEPT.read_text())

    def error(one: dict, kind: str) -> float:
        return max(one[f"{kind}_error"], one[f"own_{kind}_error"])

    for scene in {one["scene"] for one in found}:
        of_scene = {one["quality"]: one for one in found if one["scene"] == scene}
        ladder = [of_scene[quality] for quality in QUALITIES if quality in of_scene]
        assert len(ladder) >= 2
        for coarse, fine in pairwise(ladder):
            assert coarse["seconds"] < fine["seconds"]
            assert error(coarse, "water") >= error(fine, "water") and error(coarse, "shape") >= error(fine, "shape")


def test_what_beats_a_preset() -> None:
    def row(seconds: float, error: float) -> dict:
        return {"seconds": seconds, "shape_error": error}

    preset = row(1.0, 0.05)
    rows = [preset, row(0.95, 0.01), row(0.8, 0.046), row(0.8, 0.04), row(0.5, 0.06), row(None, None)]
    result = {"settings": rows, "reference": {"own_errors": {"shape_error": 0.01}}}
    assert beating(result, preset, "shape") == [row(0.8, 0.04)]
    # What the reference cannot tell apart beats nothing.
    result["reference"]["own_errors"]["shape_error"] = 0.05
    assert beating(result, preset, "shape") == []


def test_what_can_be_judged() -> None:
    result = {"reference": {"vertices": 1000, "own_errors": {"shape_error": 0.01}}}

    def row(vertices: int, error: float) -> dict:
        return {"seconds": 1.0, "vertices": vertices, "shape_error": error}

    assert can_be_judged(result, row(1000, 0.05))
    assert can_be_judged(result, row(2000, 0.005))
    assert not can_be_judged(result, row(2000, 0.05))
    assert not can_be_judged(result, row(200, 0.05) | {"seconds": None})
