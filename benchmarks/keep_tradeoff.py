"""Keep the result of ``python -m leafwarp tradeoff`` as a section of RESULTS.md.

``python -m benchmarks.keep_tradeoff DIR`` with the folder that the study wrote.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from benchmarks.results import describe_machine, write_section
from leafwarp.study.plot import format_time
from leafwarp.study.table import Row, markdown
from leafwarp.study.tradeoff import NOT_CONVERGED

TITLE = "The trade: seconds against accuracy"


def describe(result: dict) -> str:
    """The section's text."""
    rows = [Row(**row) for row in result["settings"]]
    measured = sorted((row for row in rows if row.measured), key=lambda row: row.fluid_seconds)
    film, whole = result["playback_seconds"], result["scene_playback_seconds"]
    reference, own = result["reference"], result["reference"]["own_errors"]
    width, height = reference["map_size"]
    budget = format_time(result["budget_seconds"])
    doubt = "" if reference["converged"] else f" **The reference is not converged**: {NOT_CONVERGED}."
    return (
        f"`{result['scene']}`, {result['plant_seconds'] / 3600.0:g} h of drying, compared at "
        f"{result['frames']} frames of a film of {film:.2g} s (the scene's has {whole:.3g} s). Reference: "
        f"{width} x {height}, step {format_time(reference['step'])}, unsplit, float64; its own errors, "
        f"against half the map plus against twice the step: water {own['water_error']:.2g}, "
        f"shape {own['shape_error']:.2g}. A star marks an error below these. Water error: relative L2. Shape "
        f"error: root mean square, as a share of the leaf's length.{doubt}\n\n"
        f"{markdown(measured)}\n"
        f"Left out for want of budget: {len(rows) - len(measured)} of {len(rows)} settings.\n\n"
        f'Command: `python -m leafwarp tradeoff scenes/{result["scene"]}.toml -o DIR --budget "{budget}"`. '
        f"Machine, shared with other work: {describe_machine(result['device']['alias'])}.\n"
    )


if __name__ == "__main__":
    write_section(TITLE, describe(json.loads((Path(sys.argv[1]) / "tradeoff.json").read_text())))
