"""Do the presets of quality lie on the front? Against every setting that ``tradeoff`` measured on the same scenes.

``python -m benchmarks.presets DIR ...`` with the folders of finished studies. A setting that was faster and nearer to
the reference than a preset by more than a tenth is timed again, in turns with the preset; what still beats it then is
named. Writes ``presets.json``, which a test holds against the presets of the code.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.results import write_section
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import QUALITIES
from leafwarp.study.tradeoff.study import TRIALS
from leafwarp.study.tradeoff.table import Row
from leafwarp.study.tradeoff.worker import Request, compute_apart

SCENES = Path(__file__).parent.parent / "scenes"
KEPT = Path(__file__).with_name("presets.json")
TITLE = "The presets of quality on the front"
# What counts as better, in time and in error.
BETTER = 0.9
PAIRS = 3


def beating(result: dict[str, Any], preset: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """Rows of a study that beat a preset; errors below the reference's own are taken to be that."""
    floor = result["reference"]["own_errors"][f"{kind}_error"]
    error = max(preset[f"{kind}_error"], floor)
    return [
        row
        for row in result["settings"]
        if row["seconds"] is not None
        and row["seconds"] < BETTER * preset["seconds"]
        and max(row[f"{kind}_error"], floor) < BETTER * error
    ]


def ratio_of_times(result: dict[str, Any], row: dict[str, Any], preset: dict[str, Any], folder: Path) -> float:
    """Median time of a setting's film over a preset's, each in a process of its own, in turns."""
    frames = round(result["playback_seconds"] * result["tables"]["time"]["fps"]) + 1
    scene = load_scene(SCENES / f"{result['scene']}.toml").with_changes({"time.frames": frames})
    ratios = []
    with tempfile.TemporaryDirectory() as scratch:

        def seconds(chosen: dict[str, Any]) -> float:
            asked = Row.from_dict(chosen).setting.apply(scene)
            prepare_scene_leaf(asked, Path(scratch))
            data = asked.model_dump(mode="json", exclude_unset=True)
            places, out = str(folder / TRIALS / "places.npy"), str(Path(scratch) / "trial.npz")
            request = Request(data, scene.name, scratch, places, out, result["device"]["alias"])
            return compute_apart(request, float("inf")).seconds

        for _ in range(PAIRS):
            own = seconds(preset)
            ratios.append(seconds(row) / own)
    return float(statistics.median(ratios))


def judge(folder: Path) -> list[dict[str, Any]]:
    """The presets of a study, each with what beats it."""
    result = json.loads((folder / "tradeoff.json").read_text())
    kind = "shape" if result["reference"]["one_shape"] else "water"
    found = []
    for preset in (row for row in result["settings"] if row["name"] in QUALITIES and row["seconds"] is not None):
        again = [(row, ratio_of_times(result, row, preset, folder)) for row in beating(result, preset, kind)]
        found.append(
            {
                "scene": result["scene"],
                "quality": preset["name"],
                "cells": preset["map_width"],
                "fluid_steps": round(result["plant_seconds"] / preset["fluid_step"]) if preset["fluid_step"] else None,
                "seconds": preset["seconds"],
                "water_error": preset["water_error"],
                "shape_error": preset["shape_error"],
                "own_water_error": result["reference"]["own_errors"]["water_error"],
                "own_shape_error": result["reference"]["own_errors"]["shape_error"],
                "compared_with": sum(row["seconds"] is not None for row in result["settings"]) - 1,
                "beaten_by": [
                    {"varied": row["varied"], "time": ratio, f"{kind}_error": row[f"{kind}_error"]}
                    for row, ratio in again
                    if ratio < BETTER
                ],
            }
        )
    return found


def describe(found: list[dict[str, Any]]) -> str:
    """The section's text."""
    lines = [
        "| scene | quality | film | water error | shape error | reference's own | compared with | beaten by |",
        "|---|---|---:|---:|---:|---:|---:|---|",
    ]
    for one in found:
        shape = "" if one["shape_error"] is None else f"{one['shape_error']:.2%}"
        by = "; ".join(f"{b['varied']} ({b['time']:.2f} of its time)" for b in one["beaten_by"]) or "none"
        lines.append(
            f"| {one['scene']} | {one['quality']} | {one['seconds']:.2g} s | {one['water_error']:.2%} | {shape} "
            f"| {one['own_shape_error']:.2%} | {one['compared_with']} settings | {by} |"
        )
    return (
        "A preset is beaten by a setting that takes less than 0.9 of its time, timed in turns, with less than 0.9 of "
        "its error, both held to the reference's own error.\n\n" + "\n".join(lines) + "\n\n"
        "Command: `python -m benchmarks.presets DIR ...` with the folders of `python -m leafwarp tradeoff`.\n"
    )


if __name__ == "__main__":
    every = [one for folder in sys.argv[1:] for one in judge(Path(folder))]
    KEPT.write_text(json.dumps(every, indent=1) + "\n")
    write_section(TITLE, describe(every))
    print(describe(every))
