"""Wall time by what it was spent on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """Sums wall time under names.

    Args:
        wait: Called before each reading, so that work still under way on a device counts where it was launched.

    Attributes:
        seconds: Wall time so far, by name [s].
    """

    def __init__(self, wait: Callable[[], None] | None = None):
        self.seconds: dict[str, float] = {}
        self._wait = wait

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Count what happens inside under a name."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            if self._wait is not None:
                self._wait()
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    @contextmanager
    def shared(self, names: Iterable[str]) -> Iterator[None]:
        """Count what happens inside under several names, in proportion to what each has so far."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            if self._wait is not None:
                self._wait()
            passed = time.perf_counter() - begin
            so_far = {name: self.seconds.get(name, 0.0) for name in names}
            total = sum(so_far.values())
            for name, seconds in so_far.items():
                self.seconds[name] = seconds + passed * (seconds / total if total > 0.0 else 1.0 / len(so_far))
