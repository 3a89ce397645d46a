"""Damaged and extreme scenes, pictures and calls: what the command line makes of them."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

TITLE = "Fuzzing"
ROOT = Path(__file__).parents[1]
LIMIT = 60.0  # [s] of a case, kernels being compiled included
GRACE = 2.0  # [s] in which a process that takes too long may say where it is
WORKER = (sys.executable, "-X", "faulthandler", "-m", "fuzzing.worker")
CASES_OF_A_WORKER = 1000  # before it makes room for a new one
OPTIONS: dict[str, dict[str, Any]] = {
    "--cases": {"type": int, "default": 10_000, "help": "number of cases (default: 10000)"},
    "--seed": {"type": int, "default": 0, "help": "of the cases (default: 0)"},
    "--scenes": {
        "type": int,
        "default": 1000,
        "help": "random valid scenes, too, other ones in every run, by tests/test_scene_properties.py (default: 1000)",
    },
    "--first": {"type": int, "default": 0, "help": "index of the first case (default: 0)"},
    "--workers": {"type": int, "default": 1, "help": "processes (default: 1)"},
    "--findings": {"default": "output/fuzz-findings", "metavar": "DIR", "help": "where cases are kept that went wrong"},
}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes:
        index: Its number.
        kind: How it was made; "none" where the worker ended before it was.
        code: Exit code; None where there is none.
        seconds: Wall time [s].
        faults: Everything that is wrong; empty where nothing is.
        stderr: What was written there.
    """

    index: int
    kind: str
    code: int | None
    seconds: float
    faults: tuple[str, ...]
    stderr: str = ""


class Process:
    """A worker process in a folder of its own (see ``tests/fuzzing/worker.py``), started anew when it has died.

    Args:
        seed: Seed of the cases.
        findings: Folder in which the cases are kept that went wrong, each in a folder SEED-INDEX.
        command: What to start; the folder is added.
    """

    def __init__(self, seed: int, findings: Path, command: Sequence[str] = WORKER):
        self._seed = seed
        self._findings = findings
        self._command = command
        self._index = 0
        self._begin = 0.0
        self._child: subprocess.Popen | None = None
        self._folder: Path | None = None
        self._done = 0

    def begin(self, index: int) -> None:
        """Hand a case to the worker."""
        if self._done >= CASES_OF_A_WORKER:
            self.close()
        if self._child is None:
            self._start()
        self._index, self._begin = index, time.monotonic()
        self._child.stdin.write(f"{self._seed} {index}\n".encode())
        self._child.stdin.flush()

    def _start(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="leafwarp-fuzz-"))
        (self._folder / "worker").mkdir()
        paths = [ROOT, ROOT / "kernels", ROOT / "tests", *filter(None, [os.environ.get("PYTHONPATH")])]
        self._child = subprocess.Popen(
            [*self._command, str(self._folder / "worker")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log.open("wb"),
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))},
        )
        self._done = 0
        if self._child.stdout.readline() != b"ready\n":
            raise RuntimeError(f"the worker did not start: {self._log.read_text()}")

    @property
    def _log(self) -> Path:
        """What the worker says beside its answers."""
        return self._folder / "log.txt"

    @property
    def answer(self) -> int:
        """The file descriptor that has something to read when the case has ended."""
        return self._child.stdout.fileno()

    @property
    def time_left(self) -> float:
        """Until the case has taken too long [s]."""
        return self._begin + LIMIT - time.monotonic()

    def end(self) -> Outcome:
        """Wait for the end of the case, or of its time, and say what came of it."""
        answered = select.select([self.answer], [], [], max(0.0, self.time_left))[0]
        line = self._child.stdout.readline() if answered else b""
        if line:
            self._done += 1
            answer = json.loads(line)
            outcome = Outcome(
                self._index,
                answer["kind"],
                answer["code"],
                answer["seconds"],
                tuple(answer["faults"]),
                answer["stderr"],
            )
            if outcome.faults:
                self._keep(outcome)
            return outcome
        if answered:
            fault = f"the process died with exit code {self._child.wait()}"
        else:
            fault = f"no end after {LIMIT:g} s"
            self._child.send_signal(signal.SIGABRT)  # faulthandler says where it is
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.wait(GRACE)
            self._child.kill()
        call = self._folder / "worker" / "call.json"
        kind = json.loads(call.read_text())["kind"] if call.exists() else "none"
        said = [
            path.read_text(errors="replace")
            for path in (self._folder / "worker" / "stderr", self._log)
            if path.exists()
        ]
        outcome = Outcome(self._index, kind, None, time.monotonic() - self._begin, (fault,), "".join(said)[-4000:])
        self._keep(outcome)
        self.close()
        return outcome

    def _keep(self, outcome: Outcome) -> None:
        """Keep the files of a case, how it was called and what is wrong."""
        place = self._findings / f"{self._seed}-{outcome.index}"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self._folder / "worker", place, symlinks=True, ignore=shutil.ignore_patterns("cache", "tmp"))
        (place / "finding.json").write_text(json.dumps(dataclasses.asdict(outcome), indent=1))

    def close(self) -> None:
        """End the process and remove its folder."""
        if self._child is None:
            return
        for stream in (self._child.stdin, self._child.stdout):
            stream.close()
        self._child.wait()
        self._child = None
        shutil.rmtree(self._folder)


def run_cases(indices: Sequence[int], seed: int, workers: int, findings: Path) -> Iterator[Outcome]:
    """Run cases in worker processes, and yield what came of each as it ends.

    Args:
        indices: Numbers of the cases.
        seed: Seed of all of them.
        workers: Number of processes.
        findings: Folder in which the cases are kept that went wrong, each in a folder SEED-INDEX.
    """
    waiting = iter(indices)
    idle = [Process(seed, findings) for _ in range(workers)]
    busy: list[Process] = []
    try:
        while True:
            for process, index in zip(list(idle), waiting):  # noqa: B905, what is left over waits
                idle.remove(process)
                busy.append(process)
                process.begin(index)
            if not busy:
                return
            wait = max(0.0, min(process.time_left for process in busy))
            ready = select.select([process.answer for process in busy], [], [], wait)[0]
            for process in [p for p in busy if p.answer in ready or p.time_left <= 0.0]:
                yield process.end()
                busy.remove(process)
                idle.append(process)
    finally:
        for process in (*idle, *busy):
            process.close()


def run_scenes(count: int) -> str:
    """Let pytest draw so many valid scenes, and say what it found; nothing where all is well."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_scene_properties.py"]
    environment = {**os.environ, "LEAFWARP_SCENES": str(count)}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return done.stdout if done.returncode else ""


def table(outcomes: Sequence[Outcome]) -> str:
    """Cases by kind and exit code."""
    kinds: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        kinds[outcome.kind].append(outcome)
    rows = [
        "| what is damaged or extreme | cases | exit 0 | exit 1 | exit 2 | longest [s] | findings |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for kind, group in (*sorted(kinds.items()), ("all", list(outcomes))):
        codes = [sum(outcome.code == code for outcome in group) for code in (0, 1, 2)]
        longest = max(outcome.seconds for outcome in group)
        wrong = sum(bool(outcome.faults) for outcome in group)
        rows.append(f"| {kind} | {len(group)} | {' | '.join(map(str, codes))} | {longest:.1f} | {wrong} |")
    return "\n".join(rows)


def make_body(options: argparse.Namespace) -> str:
    """The table, with what was looked for; leaves with exit code 1 where something was found."""
    indices = range(options.first, options.first + options.cases)
    outcomes, begin = [], time.monotonic()
    for outcome in run_cases(indices, options.seed, options.workers, Path(options.findings)):
        outcomes.append(outcome)
        for fault in outcome.faults:
            print(f"case {outcome.index}: {outcome.kind}: {fault}", file=sys.stderr, flush=True)
        if len(outcomes) % 500 == 0:
            print(f"{len(outcomes)}/{options.cases} {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    found = sum(bool(outcome.faults) for outcome in outcomes)
    failed = run_scenes(options.scenes) if options.scenes else ""
    if found or failed:
        print(failed + table(outcomes))
        sys.exit(f"{found} findings, kept in {options.findings}" + ", and a valid scene that fails" * bool(failed))
    scenes = (
        f"{options.scenes} random valid scenes ended with finite frames, or with a line that names frame, stage, what "
        "is wrong and what helps.\n\n"
    )
    return (scenes if options.scenes else "") + (
        "Calls of the command line with what no user means to hand it. None of them ended with a traceback, another "
        f"exit code, more than one line of error, a frame unnamed in a failure, a crash, after {LIMIT:g} s, or with a "
        f"file written outside of the output folder.\n\n{table(outcomes)}"
    )
