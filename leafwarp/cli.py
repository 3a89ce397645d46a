"""The command line. stdout carries the result path or JSON alone; everything else goes to stderr."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from leafwarp.errors import InputError, LeafwarpError

if TYPE_CHECKING:
    from leafwarp.scene import Scene


class _Parser(argparse.ArgumentParser):
    """A parser that reports a bad call in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"leafwarp: {one_line(message)}; see {self.prog} --help\n")


def one_line(message: object) -> str:
    """A message whose parts, such as the name of a file, may hold line breaks or commands to a terminal."""
    text = " ".join(str(message).split("\n"))
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)


def _frame_range(text: str) -> tuple[int, int]:
    first, separator, last = text.partition(":")
    try:
        bounds = (int(first), int(last)) if separator else (1, int(first))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: FIRST:LAST such as 1:240") from None
    if not 1 <= bounds[0] <= bounds[1]:
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: 1 <= FIRST <= LAST")
    return bounds


def _duration(text: str) -> float:
    from leafwarp.quantity import parse_quantity

    # A person types "10m"; a scene writes "10 min".
    spelled = text[:-1] + "min" if text.endswith("m") else text
    try:
        return parse_quantity(spelled, "time")
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}' is not accepted; {error}") from None


def _scene_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", type=Path, help="scene file (TOML)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of the scene")
    parser.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    parser.add_argument("-v", "--verbose", action="store_true", help="also print a summary of the run on stderr")


def make_parser() -> argparse.ArgumentParser:
    """The parser of every verb."""
    parser = _Parser(
        prog="python -m leafwarp", description="A photo of a leaf becomes an animated USD of the leaf drying."
    )
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")

    run = verbs.add_parser("run", help="simulate a scene and write its USD")
    _scene_arguments(run)
    run.add_argument("-o", "--output", type=Path, default=Path("output"), help="folder, or a .usd/.usda/.usdc file")
    run.add_argument("-f", "--frames", type=_frame_range, metavar="FIRST:LAST", help="frames to write (default: all)")
    run.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    run.add_argument("--maps", action="store_true", help="also write the maps as pictures beside the USD")
    run.add_argument("--json", action="store_true", help="print the report instead of the result's path")
    run.set_defaults(action=_run)

    plan = verbs.add_parser("plan", help="what a scene needs: stages, arrays, launches, and what is left out")
    _scene_arguments(plan)
    plan.add_argument("--json", action="store_true", help="print JSON")
    plan.set_defaults(action=_plan)

    tradeoff = verbs.add_parser("tradeoff", help="measure speed against accuracy on a scene")
    _scene_arguments(tradeoff)
    tradeoff.add_argument("-o", "--output", type=Path, required=True, help="folder of the table and the plot")
    tradeoff.add_argument(
        "--budget",
        type=_duration,
        default=600.0,
        metavar="TIME",
        help="wall time to use, such as 20m (default: 10 min)",
    )
    tradeoff.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    tradeoff.add_argument("--json", action="store_true", help="print the table as JSON instead of its path")
    tradeoff.set_defaults(action=_tradeoff)

    verify = verbs.add_parser("verify", help="run cases with known answers on this machine and print a table")
    verify.add_argument("case", nargs="*", help="names of cases (default: all)")
    verify.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    verify.add_argument("--plot", type=Path, metavar="DIR", help="also draw convergence and curves into a folder")
    verify.add_argument("--json", action="store_true", help="print JSON instead of the table")
    verify.add_argument("-q", "--quiet", action="store_true", help="no progress")
    verify.set_defaults(action=_verify)

    stability = verbs.add_parser("stability", help="sweep the extremes: how far each method holds on this machine")
    stability.add_argument("sweep", nargs="*", help="names of sweeps (default: all)")
    stability.add_argument("-o", "--output", type=Path, help="folder of the table and the plot (default: none)")
    stability.add_argument("--device", default="cpu", help="Warp device: cpu (default), cuda:0, ...")
    stability.add_argument("--overwrite", action="store_true", help="replace results that are there already")
    stability.add_argument("--json", action="store_true", help="print JSON instead of the table or its path")
    stability.add_argument("-q", "--quiet", action="store_true", help="no progress")
    stability.set_defaults(action=_stability)

    new = verbs.add_parser("new", help="write a commented scene for a photo, and a picture of what was found in it")
    new.add_argument("photo", type=Path, help="photo of a leaf")
    new.add_argument(
        "-o", "--output", type=Path, help="scene file to write (default: the photo's name with .toml, here)"
    )
    new.add_argument(
        "--length", default="10 cm", help="petiole base to farthest point, such as '8 cm' (default: 10 cm)"
    )
    new.add_argument("--maps", action="store_true", help="also write the maps as pictures beside the scene")
    new.add_argument("--overwrite", action="store_true", help="replace files that are there already")
    new.set_defaults(action=_new)

    schema = verbs.add_parser("schema", help="print the JSON Schema of a scene, for editors")
    schema.set_defaults(action=_schema)
    return parser


@contextmanager
def _arriving_signals() -> Iterator[list[int]]:
    """Numbers of the signals that arrive, so that a frame under way is finished first."""
    arrived: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda received, _: arrived.append(received)) for number in numbers]
    try:
        yield arrived
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _load_scene(arguments: argparse.Namespace) -> Scene:
    """The scene that is asked for; stderr tells what is unusual in it."""
    from leafwarp.scene.file import load_scene

    scene = load_scene(arguments.scene, arguments.set)
    for warning in scene.warnings:
        print(f"leafwarp: warning: {one_line(warning)}", file=sys.stderr)
    return scene


def _run(arguments: argparse.Namespace) -> None:
    from leafwarp.run import output_paths, run_scene

    scene = _load_scene(arguments)
    first, last = arguments.frames or (1, scene.time.frames)
    if last > scene.time.frames:
        raise InputError(f"--frames {first}:{last}: the scene has {scene.time.frames} frames (time.frames)")
    paths = output_paths(scene, arguments.output)
    with _arriving_signals() as signals:
        report = run_scene(
            scene,
            paths,
            device=arguments.device,
            frames=range(first, last + 1),
            overwrite=arguments.overwrite,
            maps=arguments.maps,
            progress_level=-1 if arguments.quiet else 0,
            signals=signals,
        )
    _warn(report["leaf"]["notes"])
    _tell_error(report["tolerance"])
    settled = report["motion"]["settled"]
    if settled is not None and not settled["settled"]:
        print(
            f"leafwarp: warning: after {settled['substeps']} substeps of settling the leaf is not yet known to be at "
            f"rest; it swung by {100 * settled['swing']:.2f} % of its length",
            file=sys.stderr,
        )
    if arguments.verbose:
        split = ", ".join(f"{name} {ms:.1f}" for name, ms in report["milliseconds_per_frame"].items())
        print(f"{report['seconds']['total']:.1f} s in all; milliseconds a frame: {split}", file=sys.stderr)
    print(json.dumps(report) if arguments.json else paths.usd)


def _tell_error(tolerance: dict[str, Any] | None) -> None:
    """Say what a film with a tolerance came to."""
    if tolerance is None or tolerance["reached"] is None:
        return
    reached, asked = 100.0 * tolerance["reached"], 100.0 * tolerance["asked"]
    state = "" if reached <= asked else "warning: "
    print(
        f"leafwarp: {state}the film's shape is off by about {reached:.2g} % of the leaf's length (tolerance: "
        f"{asked:.2g} %)",
        file=sys.stderr,
    )


def _warn(notes: Sequence[str]) -> None:
    for note in notes:
        print(f"leafwarp: note: {one_line(note)}", file=sys.stderr)


def _plan(arguments: argparse.Namespace) -> None:
    from leafwarp.plan_report import plan_report, print_plan

    report = plan_report(_load_scene(arguments), arguments.device)
    if arguments.json:
        print(json.dumps(report))
    else:
        print_plan(report)


def _tradeoff(arguments: argparse.Namespace) -> None:
    from leafwarp.study.tradeoff.study import run_tradeoff

    table = run_tradeoff(
        _load_scene(arguments),
        arguments.output,
        device=arguments.device,
        overwrite=arguments.overwrite,
        quiet=arguments.quiet,
        budget=arguments.budget,
    )
    print(json.dumps(table) if arguments.json else arguments.output / "tradeoff.csv")


def _verify(arguments: argparse.Namespace) -> int:
    from leafwarp.study.verify.table import as_data, as_text, explanations
    from leafwarp.study.verify.verification import run_verification

    results = run_verification(arguments.case, arguments.device, plots=arguments.plot, quiet=arguments.quiet)
    data = {"cases": as_data(results), "explanations": explanations(results)}
    print(json.dumps(data, allow_nan=False) if arguments.json else as_text(results))
    return 0 if all(result.passed for result in results) else 1


def _stability(arguments: argparse.Namespace) -> int:
    from leafwarp.study.stability.point import BROKEN
    from leafwarp.study.stability.study import TABLE, run_stability
    from leafwarp.study.stability.table import as_data, as_text, where

    points = run_stability(
        arguments.sweep,
        arguments.output,
        device=arguments.device,
        overwrite=arguments.overwrite,
        quiet=arguments.quiet,
    )
    broken = [point for point in points if point.outcome == BROKEN]
    for point in broken:
        print(f"leafwarp: stability: {where(point)}: {one_line(point.message)}", file=sys.stderr)
    if arguments.json:
        print(json.dumps(as_data(points, arguments.device), allow_nan=False))
    else:
        print(as_text(points) if arguments.output is None else arguments.output / TABLE)
    return 1 if broken else 0


def _new(arguments: argparse.Namespace) -> None:
    from leafwarp.new import write_new_scene

    output = arguments.output or Path(arguments.photo.with_suffix(".toml").name)
    new = write_new_scene(arguments.photo, output, arguments.length, arguments.overwrite, arguments.maps)
    _warn(new.findings.notes)
    print(f"leafwarp: see in {one_line(new.overlay)} what was found in the photo", file=sys.stderr)
    print(new.scene)


def _schema(arguments: argparse.Namespace) -> None:
    from leafwarp.scene import Scene

    print(json.dumps(Scene.model_json_schema(), indent=1))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code: 0 done, 1 failed, 2 bad input, 130 or 143 stopped by a signal."""
    try:
        parsed = make_parser().parse_args(arguments)
    except SystemExit as leaving:  # argparse has printed help or a one-line error.
        return int(leaving.code or 0)
    try:
        code = parsed.action(parsed)
        sys.stdout.flush()
    except LeafwarpError as error:
        print(f"leafwarp: {one_line(error)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("leafwarp: stopped", file=sys.stderr)
        return 130
    except OSError as error:
        # A closed pipe is no news to the one who closed it; anything else is.
        if not isinstance(error, BrokenPipeError):
            print(f"leafwarp: {one_line(error.filename or 'stdout')}: {error.strerror}", file=sys.stderr)
        sys.stdout = open(os.devnull, "w")  # the flush at exit has somewhere to go
        return 1
    return code or 0
