"""Keep the results of ``python -m leafwarp tradeoff`` as a section of RESULTS.md.

``python -m benchmarks.keep_tradeoff DIR ...`` with the folders that the studies wrote, one a scene.
"""

from __future__ import annotations

import json
import sys
from dataclasses import fields
from pathlib import Path

from benchmarks.results import describe_machine, write_section
from leafwarp.study.parts import PartCost, parts_table
from leafwarp.study.tradeoff.plot import format_time
from leafwarp.study.tradeoff.table import Row, markdown

TITLE = "The trade: seconds against accuracy"
HEADER = (
    "A star marks an error below the reference's own. Seconds: wall time of the film, without what is done once before "
    "it. Water error: relative L2; shape error: root mean square distance of a thousand points of the leaf, as a share "
    "of its length; both over 25 frames. Of each scene, the settings on one of both fronts, and those with a name.\n\n"
)


def _part(data: dict) -> PartCost:
    names = {field.name for field in fields(PartCost)}
    return PartCost(**{name: value for name, value in data.items() if name in names})


def describe(result: dict) -> str:
    """A scene's part of the section."""
    rows = [Row.from_dict(row) for row in result["settings"]]
    measured = sorted((row for row in rows if row.measured), key=lambda row: row.seconds)
    shown = [row for row in measured if row.name or row.water_pareto or row.shape_pareto]
    film, whole = result["playback_seconds"], result["scene_playback_seconds"]
    reference, own = result["reference"], result["reference"]["own_errors"]
    shorter = "" if film > 0.99 * whole else f", in a film of {film:.2g} s instead of {whole:.3g} s"
    return (
        f"### {result['scene']}\n\n"
        f"{result['plant_seconds'] / 3600.0:g} h of drying{shorter}. Reference: {reference['in_words']}; its own "
        f"errors: water {own['water_error']:.2%}, shape {own['shape_error']:.2%}"
        f"{'' if reference['converged'] else ' (**not converged**)'}.\n\n"
        f"{markdown(shown)}\n"
        + "".join(f"- {sentence}\n" for sentence in result["summary"])
        + f"\nWhat each part costs:\n\n{parts_table([_part(part) for part in result['parts']])}\n"
        + f"\nComputed {len(measured)} of {len(rows)} settings, the others for want of time or refused: "
        f"`python -m leafwarp tradeoff scenes/{result['scene']}.toml -o DIR --budget "
        f'"{format_time(result["budget_seconds"])}"`.\n\n'
    )


if __name__ == "__main__":
    results = [json.loads((Path(folder) / "tradeoff.json").read_text()) for folder in sys.argv[1:]]
    machine = f"Machine, shared with other work: {describe_machine(results[0]['device']['alias'])}.\n"
    write_section(TITLE, HEADER + "".join(map(describe, results)) + machine)
