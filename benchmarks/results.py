"""The file of results, one section a benchmark, each with the machine that it ran on."""

from __future__ import annotations

import os
import platform
from pathlib import Path

RESULTS = Path(__file__).parent / "RESULTS.md"
HEAD = "# Results\n\nEach section is written by the command that it names.\n"


def describe_machine(device: str) -> str:
    """Processor, how busy it is, device and versions, in one line."""
    import numpy as np
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING  # no greeting on stdout
    return (
        f"{_processor()}, {os.cpu_count()} logical cores{_load()}; "
        f"Warp device {device} ({wp.get_device(device).name}); "
        f"Python {platform.python_version()}, Warp {wp.__version__}, NumPy {np.__version__}, "
        f"{platform.system()}"
    )


def _load() -> str:
    if not hasattr(os, "getloadavg"):
        return ""
    return f", load average {os.getloadavg()[1]:.1f} with all that runs on them"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def write_section(title: str, body: str, path: Path = RESULTS) -> None:
    """Replace a section of the results, or add it at the end.

    Args:
        title: Its heading.
        body: Markdown, without headings of the same level.
        path: The file.
    """
    text = path.read_text(encoding="utf-8") if path.exists() else HEAD
    head, *sections = text.split("\n## ")
    kept = [section for section in sections if section.partition("\n")[0] != title]
    order = [section.partition("\n")[0] for section in sections]
    place = order.index(title) if title in order else len(kept)
    kept.insert(place, f"{title}\n\n{body.strip()}\n")
    path.write_text("\n## ".join(part.rstrip("\n") + "\n" for part in (head, *kept)), encoding="utf-8")
