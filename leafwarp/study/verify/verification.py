"""Running the cases, one after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from leafwarp.errors import InputError
from leafwarp.progress import Progress
from leafwarp.sim.launch import check_device
from leafwarp.study.verify.cases import cases_named
from leafwarp.study.verify.table import Result


def run_verification(
    names: Sequence[str] = (), device: str = "cpu", *, plots: Path | None = None, quiet: bool = False
) -> list[Result]:
    """Run verification cases.

    Args:
        names: Names of the cases; all where none is given.
        device: Warp device.
        plots: Folder to write plots to; None for none.
        quiet: No progress on stderr.

    Raises:
        InputError: There is no such case or device, or no plot could be written.
        OutputError: A plot cannot be written.
    """
    cases = cases_named(names)
    device = check_device(device)
    if plots is not None:
        if find_spec("matplotlib") is None:
            raise InputError(f"--plot {plots}: matplotlib is not installed; pip install 'leafwarp[plot]' brings it")
        try:
            plots.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"--plot {plots}: cannot be written: {error.strerror}") from None
    progress = Progress(len(cases), -1 if quiet else 0, unit="case")
    results = []
    for number, case in enumerate(cases, start=1):
        begin = time.perf_counter()
        checks = tuple(case.run(device))
        results.append(Result(case, checks, time.perf_counter() - begin))
        progress.step(number, results[-1].seconds)
    progress.close()
    if plots is not None:
        from leafwarp.study.verify.plots import write_plots

        # A case that could not be computed has nothing to draw.
        computed = [result.case.name for result in results if any(math.isfinite(c.got) for c in result.checks)]
        write_plots(computed, device, plots)
    return results
