"""Start-up: how long a fresh process takes to print its help, to its first frame, and to its end.

A run is *warm* where its leaf has been prepared and its kernels have been compiled before, *cold* where neither has.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.timing import Timing

TITLE = "Start-up"
QUICK = "one small scene, once"
ROUNDS = (7, 1)
OPTIONS: dict[str, dict] = {}
ROOT = Path(__file__).parent.parent
SCENES, QUICK_SCENES = ("bramble", "tree", "still"), ("still",)
IMPORTS = "import warp, numpy, cv2, pxr.Usd, pydantic; warp.init()"
LIBRARIES = f"the libraries alone: `python -c '{IMPORTS}'`"
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "kernels")])}


def run(arguments: list[str], kernels: Path) -> tuple[float, float | None]:
    """Run a process of Python.

    Args:
        arguments: Of the interpreter.
        kernels: Folder where compiled kernels are kept.

    Returns:
        Wall time to the end and to the line of the first frame on stderr, None where there is none [s].
    """
    environment = ENVIRONMENT | {"WARP_CACHE_PATH": str(kernels)}
    command = [sys.executable, *arguments]
    first = None
    begin = time.perf_counter()
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        said = []
        for line in process.stderr:
            said.append(line)
            if first is None and line.startswith("frame "):
                first = time.perf_counter() - begin
    total = time.perf_counter() - begin
    if process.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}\n{''.join(said)}")
    return total, first


def scene_command(scene: str, output: Path) -> list[str]:
    """Arguments that run a scene to its first frame."""
    return [
        "-m",
        "leafwarp",
        "run",
        str(ROOT / "scenes" / f"{scene}.toml"),
        "-f",
        "1:1",
        "-o",
        str(output),
        "--overwrite",
    ]


def measure(scenes: tuple[str, ...], rounds: int) -> dict[str, tuple[Timing, Timing | None]]:
    """Times to the end, and to the first frame, of all commands; they take turns."""
    found: dict[str, list[tuple[float, float | None]]] = {}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            work = {
                "`python -c pass`": ["-c", "pass"],
                LIBRARIES: ["-c", IMPORTS],
                "`--help`": ["-m", "leafwarp", "--help"],
            }
            for scene in scenes:
                for state in ("cold", "warm"):  # the second one finds what the first has left
                    work[f"`run scenes/{scene}.toml -f 1:1`, {state}"] = scene_command(scene, Path(folder) / scene)
            for name, arguments in work.items():
                kernels = Path(arguments[-2]) / "kernels" if "run" in arguments else Path(folder)
                kernels.mkdir(parents=True, exist_ok=True)
                found.setdefault(name, []).append(run(arguments, kernels))
    return {
        name: (
            Timing(tuple(total for total, _ in laps)),
            Timing(tuple(first for _, first in laps)) if laps[0][1] is not None else None,
        )
        for name, laps in found.items()
    }


def make_body(options: argparse.Namespace) -> str:
    """The table, with what it shows."""
    rows = ["| command | to the first frame [s] | to the end [s] |", "|---|---:|---:|"]
    for name, (total, first) in measure(QUICK_SCENES if options.quick else SCENES, options.rounds).items():
        rows.append(f"| {name} | {'' if first is None else first} | {total} |")
    return (
        f"Seconds: median (and middle half) of {options.rounds} fresh processes, all commands in turns. Warm: leaf and "
        "kernels of an earlier run are there. Cold: neither is. The end comes after the USD, the report and the "
        "contact sheet, where the scene has one.\n\n" + "\n".join(rows)
    )
