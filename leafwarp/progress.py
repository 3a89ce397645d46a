"""Progress on stderr: a bar on a terminal, else one flushed line a frame (or whatever is counted)."""

from __future__ import annotations

import sys
import time
from typing import TextIO


class Progress:
    """Counts frames.

    Args:
        total: Number of frames.
        level: -1 for silence, 0 or more for progress.
        stream: Where to write.
        unit: What is counted.
    """

    def __init__(self, total: int, level: int = 0, stream: TextIO | None = None, unit: str = "frame"):
        self._total = total
        self._unit = unit
        self._stream = stream or sys.stderr
        self._begin = time.perf_counter()
        self._done = 0
        self._quiet = level < 0
        self._bar = None
        if not self._quiet and self._stream.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=total, unit=unit, file=self._stream)

    def step(self, frame: int, seconds: float) -> None:
        """Say that a frame is done, and how long it took [s]."""
        self._done += 1
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.update()
            return
        self._print_line(frame, seconds)

    def _print_line(self, frame: int, seconds: float) -> None:
        left = (self._total - self._done) * (time.perf_counter() - self._begin) / self._done
        share = 100 * self._done // self._total
        line = f"{self._unit} {frame}/{self._total} {share}% {seconds:.2f} s eta {left:.0f} s"
        try:
            print(line, file=self._stream, flush=True)
        except (OSError, ValueError):
            self._quiet = True  # nobody reads any more; that is no reason to stop a run

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()
