"""A process that computes one trial: its memory is its own, and it can be stopped at any moment.

``python -m leafwarp.study.tradeoff.worker`` reads a :class:`Request` as JSON from its standard input.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from leafwarp.errors import InputError, LeafwarpError
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene import Scene
from leafwarp.study.tradeoff.trial import Trial, run_trial


@dataclass(frozen=True)
class Request:
    """What to compute.

    Attributes:
        scene: The scene, as plain data.
        where: What messages call it.
        leaves: Folder of prepared leaves.
        places: File of the points to sample [m] (NumPy).
        result: File to write the trial to.
        device: Warp device.
    """

    scene: dict[str, Any]
    where: str
    leaves: str
    places: str
    result: str
    device: str

    def compute(self) -> Trial:
        """The trial.

        Raises:
            LeafwarpError: It cannot be computed.
        """
        scene = Scene.checked(self.scene, self.where)
        leaf = prepare_scene_leaf(scene, Path(self.leaves))
        return run_trial(scene, leaf, np.load(self.places), self.device)


class OutOfTime(Exception):
    """A trial was given up because its time was over."""


class TrialFailed(LeafwarpError):
    """A trial cannot be computed: what its simulation or its process said at last."""


def compute_apart(request: Request, seconds: float) -> Trial:
    """Compute a trial in a process of its own.

    Args:
        request: What to compute.
        seconds: Wall time after which it is stopped; may be infinite.

    Raises:
        OutOfTime: It took longer.
        TrialFailed: It cannot be computed.
    """
    limit = None if seconds == float("inf") else max(seconds, 0.0)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__],
            input=json.dumps(asdict(request)),
            capture_output=True,
            text=True,
            timeout=limit,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        raise OutOfTime from None
    trial = Trial.load(Path(request.result)) if done.returncode == 0 else None
    if trial is None:
        said = done.stderr.strip().splitlines() if done.returncode == 1 else []
        raise TrialFailed(said[-1] if said else f"its process ended with code {done.returncode}")
    return trial


def compute_here(request: Request, seconds: float) -> Trial:
    """The same in this process, which cannot be stopped; a trial that took too long is given up afterwards."""
    begin = time.perf_counter()
    try:
        trial = request.compute()
    except InputError:
        raise
    except LeafwarpError as error:
        raise TrialFailed(str(error)) from None
    if time.perf_counter() - begin > seconds:
        raise OutOfTime
    trial.save(Path(request.result))
    return trial


def main() -> int:
    """Compute what standard input asks for."""
    import warp as wp

    wp.config.quiet = True
    request = Request(**json.load(sys.stdin))
    try:
        trial = request.compute()
    except LeafwarpError as error:
        print(error, file=sys.stderr)
        return 1
    from leafwarp.report import peak_memory

    replace(trial, peak_memory=peak_memory() or 0).save(Path(request.result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
