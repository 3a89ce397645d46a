"""Small studies for tests: made up, counted, interrupted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from leafwarp.scene.file import load_scene
from leafwarp.study.tradeoff import study
from leafwarp.study.tradeoff.setting import Setting
from leafwarp.study.tradeoff.study import run_tradeoff
from leafwarp.study.tradeoff.trial import Trial
from leafwarp.study.tradeoff.worker import Request, TrialFailed, compute_here

# Seconds of the made-up clock that stands for a study of every setting.
PLENTY = 1000.0
SMALLER = ("mesh.vertices=60", "maps.size=16", "time.frames=5")


class Counting:
    """Computes trials in this process and counts them; may be told to fail or to be interrupted."""

    def __init__(self, fails=lambda scene: None, interrupted_after: int | None = None):
        self.requests: list[Request] = []
        self._fails, self._interrupted_after = fails, interrupted_after

    def __call__(self, request: Request, seconds: float) -> Trial:
        if len(self.requests) == self._interrupted_after:
            raise KeyboardInterrupt
        self.requests.append(request)
        message = self._fails(request.scene)
        if message:
            raise TrialFailed(message)
        return compute_here(request, seconds)


def few_singles(scene):
    """Of the choices, one of each kind."""
    base = Setting.of(scene)
    yield from (base, base.scaled_map(2.0), base.with_(scheme="unsplit"), base.with_(fluid_step=2400.0))
    yield from (base.with_(order=2), base.with_(order=2, step_tolerance=1e-3))
    yield from (base.with_(vertices=240), base.with_(angular_springs=False), base.with_(motion="quasistatic"))
    yield from (base.with_(coupling_interval=7200.0), base.with_(substep=0.45), base.with_(precision="float64"))


def fewer_singles(scene):
    """The scene as it is, and with two choices: for what does not depend on which there are."""
    base = Setting.of(scene)
    yield from (base, base.with_(scheme="unsplit"), base.with_(motion="quasistatic"))


def run(scene_file: Path, output: Path, cache: Path, changes: tuple[str, ...] = (), **arguments) -> dict:
    scene = load_scene(scene_file, changes)
    options = {"budget": PLENTY, "quiet": True, "compute": compute_here, "cache": cache} | arguments
    return run_tradeoff(scene, output, **options)


def row_of(result: dict, varied: str) -> dict:
    (row,) = [row for row in result["settings"] if row["varied"] == varied]
    return row


@contextmanager
def quick_studies() -> Iterator[None]:
    """Studies look no further than they must: the reference is what the search begins with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "single_changes", few_singles)
        patch.setattr(study, "preset_settings", lambda scene, leaf: {"draft": Setting.of(scene).with_(vertices=80)})
        patch.setattr(study, "REFERENCE_SHARE", 0.0)
        patch.setattr(study, "PARTS_SHARE", 0.001)
        yield


def whole_study(scene_file: Path, output: Path, cache: Path) -> Path:
    """The folder of a whole study, without combinations."""
    with quick_studies(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "combinations", lambda *arguments: [])
        run(scene_file, output, cache)
    return output
