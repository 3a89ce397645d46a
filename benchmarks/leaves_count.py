"""What a leaf costs alone, and in a scene of up to a thousand: leaves of 200 vertices on maps of 64 x 64 cells.

``python -m benchmarks.leaves_count`` runs one complete update step (a fluid step, the coupling and a substep of the
motion) of ``scenes/many.toml`` with more and more leaves.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.results import describe_machine, write_section
from benchmarks.table2 import Timing, measure
from leafwarp.scene.file import load_scene
from leafwarp.sim.launch import check_device

SCENE = Path(__file__).parent.parent / "scenes" / "many.toml"
TITLE = "Leaves: what one costs among many"
COUNTS = (1, 10, 100, 1000)
REPEATS = 7


def fitted_exponent(counts: Sequence[int], milliseconds: Sequence[float]) -> float:
    """The ``p`` of ``time = c count^p``, by least squares of the logarithms; not a number for a single count."""
    x, y = ([math.log(value) for value in values] for values in (counts, milliseconds))
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    spread = sum((a - mean_x) ** 2 for a in x)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / spread if spread > 0.0 else math.nan


def make_table(counts: Sequence[int], device: str, repeats: int) -> str:
    """The table as Markdown."""
    scene = load_scene(SCENE)
    lines = [
        "| leaves | fluid step | coupling | structure substep | complete step | of it a leaf [µs] |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    totals: list[Timing] = []
    for count in counts:
        parts = measure(scene.with_changes({"leaves.count": count}), scene.maps.shape[0], device, repeats)
        totals.append(parts["fluid"] + parts["coupling"] + parts["structure"])
        columns = " | ".join(str(timing) for timing in (*parts.values(), totals[-1]))
        lines.append(f"| {count} | {columns} | {1e3 * totals[-1].median / count:.3g} |")
    exponent = fitted_exponent(counts, [total.median for total in totals])
    return "\n".join(lines) + f"\n\nTime of a complete step over leaves: fitted exponent {exponent:.2f}.\n"


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and on ``--write`` keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.leaves_count", description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="numbers of leaves")
    parser.add_argument("--repeats", type=int, default=REPEATS, help=f"rounds (default: {REPEATS})")
    parser.add_argument("--write", action="store_true", help="write the table to benchmarks/RESULTS.md")
    options = parser.parse_args(arguments)
    device = check_device(options.device)
    body = (
        f"Milliseconds: median (and middle half) of {options.repeats} measurements, float32, split scheme, "
        f"`scenes/many.toml`.\n\n{make_table(options.counts, device, options.repeats)}\n"
        f"Command: `python -m benchmarks.leaves_count --write`. Machine: {describe_machine(device)}.\n"
    )
    print(body)
    if options.write:
        write_section(TITLE, body)


if __name__ == "__main__":
    main()
