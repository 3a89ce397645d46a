"""A tolerance of the shape: the coarse films that choose a resolution, and the film that is computed again."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from leafwarp.cli import main
from leafwarp.errors import SimulationError
from leafwarp.run import CACHE_FOLDER, Interrupted, output_paths, run_scene
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import HIGHEST_LEVEL, Resolution
from leafwarp.sim.simulation import Simulation
from leafwarp.study import tolerance
from leafwarp.study.tolerance import CORRELATION, ORDER, Pass, Search, at_level, compute_film, error_from
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.trial import Film
from leafwarp.usd.check import check_usd
from scene_strategies import small_resolution, without_decided


@pytest.fixture
def small_levels(monkeypatch):
    """Levels that are coarser than the product's."""
    monkeypatch.setattr(Resolution, "of", staticmethod(small_resolution))


def film_off_by(error: float, level: int, correlation: float = CORRELATION) -> Film:
    """A film that is so far off in the root mean square, of a leaf of length 1 that should not move.

    Those of two levels err in part alike, all points along z, and in part each by a point of its own along x.
    """
    points = np.zeros((1, 30, 3))
    points[:, :, 2] = error * correlation**0.5
    points[:, level, 0] = error * ((1.0 - correlation) * 30) ** 0.5
    return Film(points, np.ones((1, 30)))


@pytest.fixture
def made_up(monkeypatch):
    """A search among films that are known; and the levels of those that it computed."""

    def search(small_scene: Path, leaf_cache: Path, wanted: float, film_of):
        computed: list[int] = []

        def film(scene, *_) -> Film:
            level = next(k for k in range(30) if Resolution.of(k).vertices == scene.mesh.vertices)
            computed.append(level)
            return film_of(level)

        monkeypatch.setattr(tolerance, "compute_film", film)
        scene = Scene.checked(without_decided(small_scene, tolerance=wanted), "scene")
        return Search(scene, leaf_cache, "cpu"), computed

    return search


def falling(first: float, order: float = ORDER):
    """Errors of an order in the size of cells and edges, of which a level takes the root of a half."""
    return lambda level: first / 2.0 ** (order * level / 2)


def off_by(errors, correlation: float = CORRELATION):
    """Films of the small scene's leaf, 8 cm long, by their level."""
    return lambda level: film_off_by(0.08 * errors(level), level, correlation)


def compute_all(search: Search) -> list[int]:
    """Have it choose until it is content; the levels of the films."""
    levels = []
    choice = search.first()
    while choice is not None:
        levels.append(choice.level)
        search.take(choice, tolerance.compute_film(choice.scene))
        choice = search.finer()
    return levels


@pytest.mark.parametrize(
    ("first", "wanted", "coarse"),
    [
        (0.001, 0.01, [1, 2]),  # the coarsest will do
        (0.02, 0.02, [1, 2]),
        (0.12, 0.02, [1, 2, 3]),  # too far ahead for the first two
        (0.30, 0.02, [1, 2, 3, 4, 5]),
        (0.30, 0.001, [1, 2, 3, 4, 5]),  # beyond the highest level
    ],
)
def test_films_grow_finer_until_the_next_is_near(
    small_scene: Path, small_levels, made_up, leaf_cache, first: float, wanted: float, coarse: list[int]
) -> None:
    search, computed = made_up(small_scene, leaf_cache, wanted, off_by(falling(first)))
    choice = search.first()
    true_error = falling(first)(choice.level)
    assert choice.expected == pytest.approx(true_error, rel=1e-6)
    assert true_error <= tolerance.AIM * wanted or choice.level == HIGHEST_LEVEL
    if choice.level > 0:  # and no finer than it must be
        assert falling(first)(choice.level - 1) > tolerance.AIM * wanted
    assert computed == coarse
    assert choice.level <= computed[-1] + tolerance.FARTHEST
    assert choice.scene.mesh.vertices == Resolution.of(choice.level).vertices
    search.take(choice, tolerance.compute_film(choice.scene))
    found = search.report()
    assert (found["reached"], found["level"]) == (pytest.approx(true_error), choice.level)
    assert (found["coarse_levels"], found["failure"]) == (coarse, None)


@pytest.mark.parametrize("level", [0, 1, 3, 5])
@pytest.mark.parametrize("other", [2, 4])
def test_an_error_is_told_from_a_distance(level: int, other: int) -> None:
    errors = falling(0.1)
    films = [film_off_by(errors(k), k) for k in (level, other)]
    distance = errors_of(*films, 1.0).shape
    assert error_from(distance, level, other) == pytest.approx(errors(level))


@pytest.mark.parametrize(
    ("order", "correlation"), [(ORDER, 0.2), (ORDER, 0.5), (ORDER, 0.9), (1.0, CORRELATION), (2.0, CORRELATION)]
)
@pytest.mark.parametrize("wanted", [0.05, 0.02, 0.007])
def test_a_tolerance_is_kept_however_fast_errors_fall_and_however_alike_they_are(
    small_scene: Path, small_levels, made_up, leaf_cache, order: float, correlation: float, wanted: float
) -> None:
    """As far apart as the measured ones lie: nine of ten correlations are within 0.3 and 0.95."""
    errors = falling(0.06, order)
    search, _ = made_up(small_scene, leaf_cache, wanted, off_by(errors, correlation))
    last = compute_all(search)[-1]
    assert errors(last) <= wanted
    assert 1.0 / 3.0 < search.report()["reached"] / errors(last) < 3.0


def jumping(first: float, until: int):
    """Films whose errors fall as is expected, but that are off by a twentieth of the length up to a level."""

    def film(level: int) -> Film:
        film = off_by(falling(first))(level)
        if level <= until:
            film.points[:, :, 1] += 0.05 * 0.08
        return film

    return film


def test_a_coarse_film_in_another_shape_does_not_make_a_good_one_be_computed_again(
    small_scene: Path, small_levels, made_up, leaf_cache
) -> None:
    """Films of levels 1 and 2 are far from that of level 4, which is right, as that of level 3 tells."""
    search, computed = made_up(small_scene, leaf_cache, 0.01, jumping(0.04, until=2))
    assert compute_all(search) == [4]
    assert computed == [1, 2, 4, 3]
    found = search.report()
    assert found["coarse_levels"] == [1, 2, 3] and len(found["passes"]) == 1
    assert found["reached"] == pytest.approx(falling(0.04)(4))


def test_a_film_that_misses_is_computed_again_finer(small_scene: Path, small_levels, made_up, leaf_cache) -> None:
    """All of the coarse ones, up to that which is next to it, are far from it."""
    search, computed = made_up(small_scene, leaf_cache, 0.01, jumping(0.04, until=3))
    assert compute_all(search) == [4, 6]
    assert computed == [1, 2, 4, 3, 6]
    found = search.report()
    first, last = found["passes"]
    assert first["expected"] == pytest.approx(falling(0.04)(4)) and first["reached"] > 0.01
    assert (found["level"], found["reached"]) == (6, last["reached"])
    assert last["reached"] == pytest.approx(falling(0.04)(6))


@pytest.mark.parametrize(("start", "levels"), [(1, [1, 3, 5]), (HIGHEST_LEVEL - 1, [HIGHEST_LEVEL - 1, HIGHEST_LEVEL])])
def test_films_are_computed_again_only_so_often(
    small_scene: Path, small_levels, made_up, leaf_cache, start: int, levels: list[int]
) -> None:
    """Each comes to another shape, however fine."""
    films = off_by(lambda level: 0.3)
    search, _ = made_up(small_scene, leaf_cache, 0.01, films)
    choice = replace(search.first(), level=start)
    done = []
    while choice is not None:
        done.append(choice.level)
        search.take(choice, films(choice.level))
        choice = search.finer()
    assert done == levels and len(done) <= tolerance.MOST_PASSES


def test_the_estimate_is_near_the_truth(small_scene: Path, scene_leaf, small_levels, leaf_cache: Path) -> None:
    """Against a film four levels finer, with an eighth of the error; more than a vertex is held at every level."""
    data = without_decided(small_scene, tolerance=0.05)
    data["time"]["frames"] = 13
    data["motion"]["pin_radius"] = 0.012
    data["curl"]["mismatch"] = [[1.0, 0.0], [0.2, 0.004]]
    scene = Scene.checked(data, "scene")
    search = Search(scene, leaf_cache, "cpu")
    choice = search.first()

    def film(level: int) -> Film:
        resolved = at_level(scene, level)
        return compute_film(resolved, search.watcher(scene_leaf(resolved)), "cpu")

    ours = film(choice.level)
    search.take(choice, ours)
    truth = errors_of(ours, film(choice.level + 4), 0.08).shape
    assert truth <= 0.05
    assert truth / 3.0 < search.report()["reached"] < 3.0 * truth


# A run with a tolerance.


@pytest.fixture
def run_small(small_scene: Path, small_levels, prepared_folder: Path):
    """Run the small scene with changes; the exit code and the report."""

    def run(*changes: str, frames: str = "1:9", options: tuple[str, ...] = ()) -> tuple[int, dict]:
        arguments = ["run", str(small_scene), "-o", str(prepared_folder), "-f", frames, "--overwrite", *options]
        for change in ("fluid.step=900", *changes):
            arguments += ["--set", change]
        code = main(arguments)
        return code, json.loads((prepared_folder / "small.report.json").read_text())

    return run


def test_a_run_with_a_tolerance_reports_what_it_reached(run_small, capsys) -> None:
    code, report = run_small("tolerance=0.2")
    captured = capsys.readouterr()
    assert code == 0 and "coarse film of level 2" in captured.err and "tolerance: 20 %" in captured.err
    found = report["tolerance"]
    assert found["asked"] == 0.2 and 0.0 < found["reached"] < 0.2 and found["coarse_levels"] == [1, 2]
    assert found["passes"] == [{name: found[name] for name in ("level", "expected", "reached")}]
    # What the command line says itself stands.
    assert set(found["resolution"]) == {"mesh.vertices", "maps.size", "fluid.scheme"}
    assert report["fluid"]["step_seconds"] == 900.0
    assert report["seconds"]["tolerance"] > 0.0


def test_part_of_a_film_has_no_error_to_report(run_small) -> None:
    code, report = run_small("tolerance=0.2", frames="1:2")
    assert code == 0 and report["tolerance"]["reached"] is None


@pytest.fixture
def films_miss(monkeypatch):
    """Films of the levels 0 to 2 are said to be off by 30 %, finer ones by 1 %; coarse ones by next to nothing."""
    whole = Search.take

    def take(search: Search, choice, film) -> None:
        monkeypatch.setattr(Search, "_error", lambda search, level: 0.3 if level <= 2 else 0.01)
        whole(search, choice, film)

    monkeypatch.setattr(Search, "_error", lambda search, level: 1e-4)
    monkeypatch.setattr(Search, "take", take)


def points_of(usd: Path) -> tuple[int, int]:
    """How many frames a USD has, and how many points."""
    stage = Usd.Stage.Open(str(usd))
    mesh = next(UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    samples = mesh.GetPointsAttr().GetTimeSamples()
    return len(samples), len(mesh.GetPointsAttr().Get(samples[-1]))


def files_in(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()} - {CACHE_FOLDER}


def test_a_run_that_misses_its_tolerance_replaces_its_film(
    small_scene: Path, run_small, films_miss, prepared_folder: Path, capsys
) -> None:
    code, report = run_small("tolerance=0.1", "output.contact_sheet=true", options=("--maps",))
    said = capsys.readouterr().err
    assert code == 0
    assert "film of level 0: its shape is off by about 30 % of the length, more than 10 %: once more at level 2" in said
    assert "film of level 2: its shape is off by about 30 %" in said and "level 4" in said
    assert [one["level"] for one in report["tolerance"]["passes"]] == [0, 2, 4]
    assert report["tolerance"]["reached"] == 0.01
    assert points_of(prepared_folder / "small.usd") == (9, report["mesh"]["vertices"])
    assert report["mesh"]["vertices"] > 0.9 * Resolution.of(4).vertices
    results = {"small.usd", "small.report.json", "small_contact_sheet.png", "small_texture.png"}
    maps = {f"small.{name}.png" for name in load_scene(small_scene).map_names}
    assert files_in(prepared_folder) == results | maps and maps
    assert report["map"][0] >= Resolution.of(3).cells
    assert check_usd(prepared_folder / "small.usd") == []


def test_a_finer_film_that_fails_leaves_the_one_before_it(
    run_small, films_miss, prepared_folder: Path, monkeypatch, capsys
) -> None:
    advance = Simulation.advance
    before: list[bytes] = []

    def fail_when_fine(simulation: Simulation, index: int) -> None:
        if len(before) == 0 and simulation.scene.mesh.vertices == Resolution.of(2).vertices and index == 5:
            # Not a coarse film's, which come before there is any.
            if (prepared_folder / "small.usd").exists():
                before.append((prepared_folder / "small.usd").read_bytes())
                raise SimulationError(index, "motion", "is not to be")
        advance(simulation, index)

    monkeypatch.setattr(Simulation, "advance", fail_when_fine)
    code, report = run_small("tolerance=0.1")
    said = capsys.readouterr().err
    assert code == 0 and "a finer film cannot be computed: frame 5: motion: is not to be" in said
    assert "warning: the film's shape is off by about 30 %" in said
    assert before == [(prepared_folder / "small.usd").read_bytes()]
    assert points_of(prepared_folder / "small.usd") == (9, report["mesh"]["vertices"])
    found = report["tolerance"]
    assert (found["level"], found["reached"], len(found["passes"])) == (0, 0.3, 1)
    assert "is not to be" in found["failure"]
    assert files_in(prepared_folder) == {"small.usd", "small.report.json", "small_texture.png"}


@pytest.mark.parametrize("moment", ["coarse", "finer"])
def test_a_signal_in_a_second_film_leaves_the_first(
    small_scene: Path, small_levels, films_miss, prepared_folder: Path, monkeypatch, moment: str
) -> None:
    """It arrives in the finer film, or in the coarse film that is to tell whether there must be one."""
    scene = load_scene(small_scene, ["tolerance=0.1", "fluid.step=900"])
    paths = output_paths(scene, prepared_folder)
    signals: list[int] = []
    first: list[bytes] = []
    advance = Simulation.advance
    # A first film of level 0 has no coarse one beside it, one of level 4 has.
    if moment == "coarse":
        monkeypatch.setattr(Search, "first", lambda search: search._choice(4, 0.01, 4))
        monkeypatch.setattr("leafwarp.study.tolerance.estimated_error", lambda *_: 0.3)
        monkeypatch.setattr(Search, "_error", lambda *_: 0.3)
        monkeypatch.setattr(Search, "take", lambda search, choice, _: search._passes.append(Pass(choice, 0.3)))
    level = 3 if moment == "coarse" else 2

    def arrive(simulation: Simulation, index: int) -> None:
        if paths.usd.exists() and simulation.scene.mesh.vertices == Resolution.of(level).vertices and index == 4:
            first.append(paths.usd.read_bytes())
            signals.append(signal.SIGINT)
        advance(simulation, index)

    monkeypatch.setattr(Simulation, "advance", arrive)
    with pytest.raises(Interrupted, match="stopped by SIGINT before a finer film was whole") as stopped:
        run_scene(scene, paths, signals=signals, progress_level=-1)
    assert stopped.value.exit_code == 130
    assert first == [paths.usd.read_bytes()] and points_of(paths.usd)[0] == 9
    assert files_in(prepared_folder) == {"small.usd", "small.report.json", "small_texture.png"}
    assert json.loads(paths.report.read_text())["tolerance"]["reached"] == 0.3


def test_a_signal_in_a_coarse_film_ends_the_run_at_its_frame(
    small_scene: Path, small_levels, prepared_folder: Path
) -> None:
    scene = load_scene(small_scene, ["tolerance=0.1"])
    with pytest.raises(Interrupted, match="stopped by SIGTERM in a coarse film; there is no film yet"):
        run_scene(scene, output_paths(scene, prepared_folder), signals=[signal.SIGTERM], progress_level=-1)
    assert files_in(prepared_folder) == set()


def test_a_finer_film_that_has_no_place_leaves_the_one_before_it(
    run_small, films_miss, prepared_folder: Path, capsys
) -> None:
    (prepared_folder / ".small.usd.finer").write_text("in the way")
    code, report = run_small("tolerance=0.1")
    assert code == 1 and ".small.usd.finer: cannot be made: File exists" in capsys.readouterr().err
    assert points_of(prepared_folder / "small.usd") == (9, report["mesh"]["vertices"])


def test_what_a_killed_run_left_of_a_finer_film_goes(run_small, films_miss, prepared_folder: Path) -> None:
    left = prepared_folder / ".small.usd.finer"
    left.mkdir()
    (left / "small_contact_sheet.png").write_bytes(b"old")
    assert run_small("tolerance=0.1")[0] == 0
    assert files_in(prepared_folder) == {"small.usd", "small.report.json", "small_texture.png"}


def test_a_coarse_film_that_fails_says_so(small_scene: Path, small_levels, leaf_cache: Path) -> None:
    scene = load_scene(small_scene, ["tolerance=0.1", "solver.maximum_substeps=1"])
    with pytest.raises(SimulationError, match=r"frame 2: coarse film for tolerance: motion: needs .* substeps"):
        Search(scene, leaf_cache, "cpu").first()


def test_without_a_tolerance_nothing_of_it_is_loaded(small_scene: Path, tmp_path: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from pathlib import Path; from leafwarp.scene.file import load_scene; "
        "from leafwarp.run import output_paths, run_scene; "
        f"scene = load_scene(Path({str(small_scene)!r})); "
        f"run_scene(scene, output_paths(scene, Path({str(tmp_path)!r})), frames=range(1, 2), progress_level=-1); "
        "print([name for name in sys.modules if name.startswith('leafwarp.study')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


# Fluid steps, which look after themselves.


def asked_for(small_scene: Path, **changes) -> Scene:
    """The small scene with a tolerance, and with keys of its fluid's own."""
    data = without_decided(small_scene, tolerance=0.01)
    data["fluid"] |= changes
    return Scene.checked(data, "scene")


def test_a_tolerance_lets_fluid_steps_adapt(small_scene: Path) -> None:
    scene = asked_for(small_scene)
    for level in (None, 0, 3):
        fluid = (scene if level is None else at_level(scene, level)).fluid
        assert (fluid.scheme, fluid.order, fluid.step_tolerance) == ("unsplit", 2, pytest.approx(1e-3))
        assert fluid.step == scene.time.duration / 40


@pytest.mark.parametrize(
    "said", [{"step": 300.0}, {"order": 1}, {"order": 2}, {"order": 2, "step_tolerance": 0.02}, {"scheme": "split"}]
)
def test_steps_that_the_scene_gives_stand(small_scene: Path, said: dict) -> None:
    fluid = at_level(asked_for(small_scene, **said), 2).fluid
    assert {key: getattr(fluid, key) for key in said} == said
    assert fluid.step_tolerance == said.get("step_tolerance")


def test_steps_stay_even_where_a_set_is_kept(small_scene: Path) -> None:
    data = without_decided(small_scene, tolerance=0.01)
    data["shrink"]["plastic_set"] = 0.3
    assert Scene.checked(data, "scene").fluid.step_tolerance is None


def test_adapted_steps_leave_the_tolerance_to_map_and_mesh(small_scene: Path, scene_leaf, device) -> None:
    """Water is cut off in mid-film: steps shorten, and smaller errors of theirs change a tenth of the tolerance."""
    fast = {"source.conductance": 20.0 / 3600.0, "fluid.vein_diffusivity": 1e-5, "fluid.lamina_diffusivity": 1e-8}
    coarse = {"maps.size": 24, "mesh.vertices": 60, "tolerance": None}
    scene = at_level(asked_for(small_scene), 0).with_changes(coarse | fast)
    films, simulation = [], None
    for share in (1.0, 0.05):
        one = scene.with_changes({"fluid.step_tolerance": share * scene.fluid.step_tolerance})
        simulation = Simulation(one, scene_leaf(one), device)
        films.append([frame.points for frame in simulation.frames()])
        assert simulation.fluid.shortest_step < scene.fluid.step and simulation.fluid.steps_over_tolerance == 0
    distance = np.sqrt(np.mean(np.square(np.subtract(*films)).sum(axis=-1)))
    assert 0.0 < distance < 0.1 * 0.01 * 0.08
