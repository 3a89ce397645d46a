"""``python -m benchmarks [NAME] [options]``: the paper's Table II, or another benchmark by its name.

A benchmark is a module with

- ``TITLE``, the heading of its section of the results,
- ``QUICK``, what its quick form leaves out; without it there is none,
- ``ROUNDS``, the measurements of everything, in full and in the quick form; without it there is no choice,
- ``OPTIONS``, its own options: what :meth:`argparse.ArgumentParser.add_argument` takes, by their names,
- ``make_body(options)``, which measures and returns the tables as Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks import clocks, fluid, fuzz, guards, memory, scaling, startup, structure, table2, tolerance, unsplit
from benchmarks.peers import motion as peers
from benchmarks.results import describe_machine, write_section
from leafwarp.errors import InputError
from leafwarp.sim.launch import check_device

BENCHMARKS = {
    "table2": table2,
    "fluid": fluid,
    "unsplit": unsplit,
    "structure": structure,
    "scaling": scaling,
    "memory": memory,
    "startup": startup,
    "clocks": clocks,
    "tolerance": tolerance,
    "guards": guards,
    "peers": peers,
    "fuzz": fuzz,
}
UNNAMED = "table2"
ALL = tuple(name for name in BENCHMARKS if name not in ("peers", "fuzz"))


def make_parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure and print tables in Markdown.",
        epilog=f"Without a name: {UNNAMED}. NAME --help lists the options of a benchmark.",
    )
    names = parser.add_subparsers(dest="name", metavar="NAME")
    for name, module in BENCHMARKS.items():
        summary = module.__doc__.partition("\n")[0]
        one = names.add_parser(name, help=summary, description=summary)
        one.set_defaults(device="cpu")
        if hasattr(module, "ROUNDS"):
            one.add_argument("--rounds", type=_count, help=f"measurements of each (default: {module.ROUNDS[0]})")
        for option, settings in module.OPTIONS.items():
            one.add_argument(option, **settings)
        if hasattr(module, "QUICK"):
            one.add_argument("--quick", action="store_true", help=module.QUICK)
        _add_write(one)
    every = names.add_parser("all", help=f"all but peers and fuzz: {', '.join(ALL)}")
    every.add_argument("--quick", action="store_true", help="the quick form of each")
    _add_write(every)
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: accepted: a whole number from 1")
    return int(text)


def _add_write(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--write", action="store_true", help="keep the tables in benchmarks/RESULTS.md")


def spelled(arguments: Sequence[str], options: argparse.Namespace) -> str:
    """The command as it was typed, but for the paths of interpreters."""
    flags = {f"--{name}" for name, value in vars(options).items() if isinstance(value, Path)}
    words = list(arguments)
    for place, word in enumerate(words):
        if word in flags:
            words[place + 1] = "PYTHON"
        elif word.partition("=")[0] in flags:
            words[place] = word.partition("=")[0] + "=PYTHON"
    return " ".join(["python -m benchmarks", *words])


def run(name: str, options: argparse.Namespace, command: str) -> None:
    """Measure, print, and on ``--write`` keep the tables of one benchmark."""
    module = BENCHMARKS[name]
    if hasattr(module, "ROUNDS"):
        options.rounds = options.rounds or module.ROUNDS[options.quick]
    body = (
        f"{module.make_body(options).strip()}\n\nCommand: `{command}`. Machine: {describe_machine(options.device)}.\n"
    )
    print(body)
    if options.write:
        write_section(module.TITLE, body)


def main(arguments: Sequence[str]) -> int:
    """Run one benchmark, or all of them."""
    parser = make_parser()
    unnamed = not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help"))
    given = [UNNAMED, *arguments] if unnamed else list(arguments)
    options = parser.parse_args(given)
    if options.name == "all":
        for name in ALL:
            own = [name, *given[1:]]
            run(name, parser.parse_args(own), spelled(own, options))
        return 0
    try:
        options.device = check_device(options.device)
        run(options.name, options, spelled(arguments, options))
    except InputError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
