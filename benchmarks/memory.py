"""Memory: the arrays of a run and the most that its process ever took, by the size of map and mesh."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.startup import ENVIRONMENT, scene_command

TITLE = "Memory"
QUICK = "one small size of a scene without fluid"
OPTIONS: dict[str, dict] = {}
# Cells across and vertices.
SIZES = ((128, 1707), (256, 1707), (512, 1707), (1024, 1707), (2048, 1707), (256, 500), (256, 5000), (256, 20_000))
QUICK_SIZES = ((32, 200),)
SCENE, QUICK_SCENE = "bramble", "still"


def measure(scene: str, cells: int, vertices: int, folder: Path) -> dict[str, int]:
    """Bytes of arrays and of the process of a run of a scene to its first frame."""
    changes = {
        "maps.size": cells,
        "mesh.vertices": vertices,
        "output.contact_sheet": "false",
        "solver.maximum_substeps": 10**6,
    }
    command = [sys.executable, *scene_command(scene, folder), "--json", "-q"]
    for key, value in changes.items():
        command += ["--set", f"{key}={value}"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")
    return json.loads(done.stdout)["memory"]


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    rows = [
        "| map | vertices | arrays [MB] | peak, leaf prepared before [MB] | peak, leaf made anew [MB] |",
        "|---:|---:|---:|---:|---:|",
    ]
    scene = QUICK_SCENE if options.quick else SCENE
    for cells, vertices in QUICK_SIZES if options.quick else SIZES:
        with tempfile.TemporaryDirectory() as folder:
            anew, again = (measure(scene, cells, vertices, Path(folder)) for _ in range(2))
        arrays, peaks = again["arrays_bytes"] / 1e6, [run["peak_bytes"] for run in (again, anew)]
        shown = " | ".join("" if peak is None else f"{peak / 1e6:.0f}" for peak in peaks)
        rows.append(f"| {cells} | {vertices} | {arrays:.3g} | {shown} |")
    return (
        f"`scenes/{scene}.toml` to its first frame, float32, without the contact sheet, which has arrays of its own. "
        "The peak is that of the whole process, with Python and its libraries.\n\n" + "\n".join(rows)
    )
