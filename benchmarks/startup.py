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

from benchmarks.results import describe_machine, write_section
from benchmarks.timing import Timing

TITLE = "Start-up"
ROOT = Path(__file__).parent.parent
SCENES, QUICK_SCENES = ("bramble", "tree", "still"), ("still",)
ROUNDS, QUICK_ROUNDS = 7, 1
IMPORTS = "import warp, numpy, cv2, pxr.Usd, pydantic; warp.init()"
LIBRARIES = f"the libraries alone: `python -c '{IMPORTS}'`"
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "kernels")])}


def run(arguments: list[str], kernels: Path) -> tuple[float, float | None]:
    """Run a process of Python.

    Args:
        arguments: Of the interpreter.
        kernels: Folder where compiled kernels are kept.

    Returns:
        Wall time to the end and to the line of the first frame on stderr, None where there is none [ms].
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
                first = 1e3 * (time.perf_counter() - begin)
    total = 1e3 * (time.perf_counter() - begin)
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


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and on ``--write`` keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks startup", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, help=f"measurements of each (default: {ROUNDS})")
    parser.add_argument("--quick", action="store_true", help="one small scene, once")
    parser.add_argument("--write", action="store_true", help="keep the table in benchmarks/RESULTS.md")
    options = parser.parse_args(arguments)
    rounds = options.rounds or (QUICK_ROUNDS if options.quick else ROUNDS)
    rows = ["| command | to the first frame [s] | to the end [s] |", "|---|---:|---:|"]
    for name, (total, first) in measure(QUICK_SCENES if options.quick else SCENES, rounds).items():
        rows.append(f"| {name} | {'' if first is None else seconds(first)} | {seconds(total)} |")
    body = (
        f"Seconds: median (and middle half) of {rounds} fresh processes, all commands in turns. Warm: leaf and kernels "
        "of an earlier run are there. Cold: neither is. The end comes after the USD, the report and the contact sheet, "
        "where the scene has one.\n\n" + "\n".join(rows) + "\n\n"
        f"Command: `python -m benchmarks startup --write`. Machine: {describe_machine('cpu')}.\n"
    )
    print(body)
    if options.write:
        write_section(TITLE, body)


def seconds(timing: Timing) -> Timing:
    """The same in seconds."""
    return Timing(tuple(value / 1e3 for value in timing.milliseconds))


if __name__ == "__main__":
    main()
