"""Running the sweeps, one after the other."""

from __future__ import annotations

import faulthandler
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from leafwarp.errors import InputError, OutputError
from leafwarp.files import write_text
from leafwarp.progress import Progress
from leafwarp.sim.launch import check_device
from leafwarp.study.stability.plot import plot_envelopes
from leafwarp.study.stability.point import Point, judge
from leafwarp.study.stability.sweeps import sweeps_named
from leafwarp.study.stability.table import as_csv

TABLE, PICTURE = "stability.csv", "stability.png"
# Of a point; those that are there take some seconds at the most.
LONGEST = 120.0  # [s]


def run_stability(
    names: Sequence[str] = (),
    output: Path | None = None,
    *,
    device: str = "cpu",
    overwrite: bool = False,
    quiet: bool = False,
) -> list[Point]:
    """Sweep the extremes.

    A point that does not end within :data:`LONGEST` ends the program, with exit code 1.

    Args:
        names: Names of the sweeps; all where none is given.
        output: Folder of ``stability.csv``, written anew after every sweep, and ``stability.png``; None: none.
        device: Warp device.
        overwrite: Replace a table that is there already.
        quiet: No progress on stderr.

    Raises:
        InputError: There is no such sweep or device, or a table is there already.
        OutputError: The table or the picture cannot be written.
    """
    sweeps = sweeps_named(names)
    device = check_device(device)
    if output is not None:
        _prepare(output, overwrite)
    progress = Progress(len(sweeps), -1 if quiet else 0, unit="sweep")
    points: list[Point] = []
    for number, sweep in enumerate(sweeps, start=1):
        before = len(points)
        for trial in sweep.trials(device):
            what = f"{sweep.name} = {trial.value:g}, {trial.method}, {trial.precision}"
            with _ends_within(LONGEST, what):
                points.append(judge(sweep, trial))
        progress.step(number, sum(point.seconds for point in points[before:]))
        if output is not None:
            write_text(output / TABLE, as_csv(points))
    progress.close()
    if output is not None and find_spec("matplotlib") is not None:
        plot_envelopes(points, output / PICTURE)
    return points


def _prepare(output: Path, overwrite: bool) -> None:
    """Make the folder, and leave nothing in it that another run has written."""
    table = output / TABLE
    if table.exists() and not overwrite:
        raise InputError(f"{table}: exists already; --overwrite replaces it")
    if find_spec("matplotlib") is None:
        print(
            "leafwarp: matplotlib is not installed: the table is written without a plot; "
            "pip install 'leafwarp[plot]' brings it",
            file=sys.stderr,
        )
    try:
        output.mkdir(parents=True, exist_ok=True)
        (output / PICTURE).unlink(missing_ok=True)
        write_text(table, as_csv([]))
    except (OSError, OutputError) as error:
        raise InputError(f"{output}: cannot be written: {error}") from None


@contextmanager
def _ends_within(seconds: float, what: str) -> Iterator[None]:
    """End the program where a computation does not end: nothing else stops one that is within a library."""

    def give_up() -> None:
        print(f"leafwarp: stability: {what}: has not ended within {seconds:g} s", file=sys.stderr, flush=True)
        faulthandler.dump_traceback()
        os._exit(1)

    timer = threading.Timer(seconds, give_up)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
