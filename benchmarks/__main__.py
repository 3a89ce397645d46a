"""``python -m benchmarks [NAME] [options]``: the paper's Table II, or another benchmark by its name."""

from __future__ import annotations

import sys
from importlib import import_module

# Each has ``main(arguments)``; what it does is said by its docstring.
PLACES = {
    "table2": "benchmarks.table2",
    "fluid": "benchmarks.fluid",
    "structure": "benchmarks.structure",
    "scaling": "benchmarks.scaling",
    "memory": "benchmarks.memory",
    "startup": "benchmarks.startup",
    "peers": "benchmarks.peers.motion",
}
USAGE = """usage: python -m benchmarks [NAME] [--quick] [--write] [other options of the benchmark]

  table2     the paper's Table II: one complete update step (this one without a name)
  fluid      one split step, beside a scalar thread a line, LAPACK, NumPy, SciPy and FiPy (where installed)
  structure  one substep of explicit motion, beside plain kernels, and Newton (--newton PYTHON)
  scaling    cost against cells and vertices, with fitted exponents
  memory     arrays and peak memory against cells and vertices
  startup    help, first frame and end of a run, warm and cold
  peers      one simulated second beside Blender (--blender PYTHON) and Newton (--newton PYTHON)
  all        all but the last

--quick ends in seconds and measures little; --write keeps the table in benchmarks/RESULTS.md; NAME --help says more.
"""


def main(arguments: list[str]) -> int:
    """Run one benchmark, or all of them."""
    if arguments and arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0
    named = bool(arguments) and not arguments[0].startswith("-")
    name, options = (arguments[0], arguments[1:]) if named else ("table2", arguments)
    if name != "all" and name not in PLACES:
        print(f"benchmarks: '{name}' is not accepted; accepted: {', '.join(PLACES)}, all", file=sys.stderr)
        return 2
    for each in [name] if name != "all" else [each for each in PLACES if each != "peers"]:
        import_module(PLACES[each]).main(options)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
