"""Devices, precisions and debug mode of the whole suite."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

if "PYTEST_XDIST_WORKER" in os.environ:
    # There is a worker for every core: threads of their own would wait for each other. Read as the libraries load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", action="append", default=[], help="Warp device to test on; repeatable (default: cpu)")
    parser.addoption("--debug-kernels", action="store_true", help="compile kernels with bounds checks")
    parser.addoption(
        "--launching",
        action="store_true",
        help="leave out tests that launched no kernel when they passed without checks",
    )
    parser.addoption("--like-gpu", action="store_true", help="on the CPU: round and hand out arrays as a GPU does")
    parser.addoption("--slow", action="store_true", help="also run what takes minutes, and further cases of long tests")


def pytest_configure(config: pytest.Config) -> None:
    import warp as wp

    config.addinivalue_line("markers", "slow: takes minutes, or is a further case of a test; skipped without --slow")
    wp.config.quiet = True
    if config.getoption("--debug-kernels"):
        _check_bounds(config)
    if config.getoption("--like-gpu"):
        _act_like_a_gpu()
    if config.pluginmanager.has_plugin("cacheprovider"):
        from kernel_launches import KernelLaunches

        config.pluginmanager.register(KernelLaunches(config))


def _check_bounds(config: pytest.Config) -> None:
    """Let kernels end the process at an index out of bounds, still optimised as in release mode where Warp allows it.

    Warp's debug mode does not optimise: the tests of water and motion take five times as long in it.
    """
    import warp as wp

    if any(device != "cpu" for device in config.getoption("--device")):
        wp.config.mode = "debug"
        return
    header = Path(__file__).with_name("check_bounds.h")
    if len(str(header).split()) != 1:
        raise pytest.UsageError(f"--debug-kernels: a path with a space cannot be given to Warp's compiler: {header}")
    wp.config.cpu_compiler_flags += f" -include {header}"
    # Else kernels with checks use a pointer to their stack, of which there is one for all threads that launch them.
    wp.config.enable_tiles_in_stack_memory = False


def _act_like_a_gpu() -> None:
    """Launch what a GPU would, fuse multiplications with additions as its compiler does, and read arrays as copies."""
    import warp as wp

    from leafwarp.sim.launch import State

    wp.config.cpu_compiler_flags += " -ffp-contract=fast"
    read = wp.array.numpy

    def copied(array: wp.array, **options):
        values = read(array, **options).copy()
        values.flags.writeable = False
        return values

    wp.array.numpy = copied
    State.many_threads = property(lambda state: True)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """With -n, a worker begins with neighbouring tests, which share fixtures, and takes over what others have left."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long tests first: at the end one of them would keep a single worker busy. Slow ones only where asked for."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    if not config.getoption("--slow"):
        for item in items:
            if item.get_closest_marker("slow") is not None:
                item.add_marker(pytest.mark.skip(reason="takes long: --slow runs it"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", metafunc.config.getoption("--device") or ["cpu"])
    if "precision" in metafunc.fixturenames:
        metafunc.parametrize("precision", ["float32", "float64"])


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels(request: pytest.FixtureRequest) -> None:
    """Every kernel in both precisions, each module compiled once.

    Warp compiles a module again for every set of kernels and precisions that is asked of it, and the tests, in
    whatever order, ask for many. Of two workers one begins with the first module and one with the last; each finds in
    the cache what the other has compiled when they meet.
    """
    import warp as wp

    from every_kernel import MODULES, kernels_of

    modules = list(dict.fromkeys(kernel.module for name in MODULES for kernel in kernels_of(name)))
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    pairs = (int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 1)) + 1) // 2
    first = worker // 2 * len(modules) // pairs
    modules = modules[first:] + modules[:first]
    if worker % 2:
        modules.reverse()
    for device in request.config.getoption("--device") or ["cpu"]:
        for module in modules:
            wp.force_load(device, [module])


@pytest.fixture(scope="session", autouse=True)
def shared_analysis() -> Iterator[None]:
    """Tests that prepare leaves of the same picture find what is in it once."""
    from shared_analysis import share

    with pytest.MonkeyPatch.context() as patch:
        share(patch)
        yield


@pytest.fixture
def analysis_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every preparation of the test finds all of it itself."""
    from shared_analysis import compute_anew

    compute_anew(monkeypatch)


@pytest.fixture(scope="session")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drawn photo: a green elliptic leaf with a petiole and a midrib on light paper."""
    import cv2
    import numpy as np

    picture = np.full((320, 200, 3), 235, np.uint8)
    cv2.ellipse(picture, (100, 140), (62, 110), 0, 0, 360, (60, 140, 70), -1, cv2.LINE_AA)
    cv2.line(picture, (100, 240), (100, 300), (60, 130, 80), 9, cv2.LINE_AA)
    cv2.line(picture, (100, 295), (100, 45), (120, 190, 150), 4, cv2.LINE_AA)
    for side in (-1, 1):
        for foot in range(80, 230, 30):
            cv2.line(picture, (100, foot), (100 + 42 * side, foot - 25), (110, 180, 140), 2, cv2.LINE_AA)
    path = tmp_path_factory.mktemp("photo") / "drawn.png"
    cv2.imwrite(str(path), picture)
    return path


@pytest.fixture(scope="session")
def small_scene(photo: Path) -> Path:
    """A scene file on the drawn photo that asks for everything, small enough to run in a second."""
    path = photo.with_name("small.toml")
    path.write_text(SMALL_SCENE)
    return path


SMALL_SCENE = """
[leaf]
image = "drawn.png"
length = "8 cm"
camber = 0.02
[mesh]
vertices = 120
[maps]
size = [24, 32]
[time]
duration = "8 h"
frames = 9
fps = 24
[fluid]
step = "10 min"
[transpiration]
rate = "0.08 1/h"
cuticle_rate = "0.02 1/h"
[source]
conductance = "0.2 1/h"
cut_at = "2 h"
[shrink]
curve = [[1.0, 0.0], [0.2, 0.2]]
vein_resistance = 0.5
[curl]
mismatch = [[1.0, 0.0], [0.2, 0.01]]
[structure]
membrane_stiffness = 6.0
bending_stiffness = 1e-5
vein_stiffness = 3.0
stiffness = [[1.0, 1.0], [0.8, 0.7], [0.2, 1.2]]
[motion]
gravity = [0.0, 0.0, -0.1]
drag = 4.0
[output]
display_color = true
"""


TWO_PHOTOS = """
[[leaf]]
image = "drawn.png"
length = "8 cm"
[[leaf]]
image = "other.png"
length = "4 cm"
camber = 0.0
"""


@pytest.fixture(scope="session")
def two_photos(small_scene: Path) -> Path:
    """A scene of two photos: the drawn one, and its mirror image."""
    import cv2

    picture = cv2.imread(str(small_scene.with_name("drawn.png")))
    cv2.imwrite(str(small_scene.with_name("other.png")), picture[::-1])
    tables = small_scene.read_text().split("[mesh]")[1]
    path = small_scene.with_name("two.toml")
    path.write_text(TWO_PHOTOS + "[mesh]" + tables)
    return path


SCENES = Path(__file__).parent.parent / "scenes"


@pytest.fixture
def leaf_file(tmp_path: Path) -> Path:
    """A scene file of a leaf stated in SI units; its photo is not there."""
    from material_scenes import SI_SCENE

    path = tmp_path / "leaf.toml"
    path.write_text(SI_SCENE)
    return path


@pytest.fixture(scope="session")
def leaf_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of prepared leaves, found by content: one for all workers."""
    folder = tmp_path_factory.getbasetemp()
    return (folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "leaves"


@pytest.fixture(scope="session")
def scene_leaf(leaf_cache: Path):
    """The prepared leaf of a scene, prepared once a session."""
    from leafwarp.prepare import prepare_scene_leaf

    return lambda scene: prepare_scene_leaf(scene, leaf_cache)


@pytest.fixture(scope="module")
def quick_study() -> Iterator[None]:
    """Studies of the trade that look no further than they must."""
    from tradeoff_studies import quick_studies

    with quick_studies():
        yield


@pytest.fixture(scope="session")
def study_folder(small_scene: Path, leaf_cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole study of the small scene."""
    from tradeoff_studies import whole_study

    return whole_study(small_scene, tmp_path_factory.mktemp("trade"), leaf_cache)


@pytest.fixture
def prepared_folder(tmp_path: Path, leaf_cache: Path) -> Path:
    """A folder for the results of a run that finds its leaf prepared, once one of the session has prepared it."""
    from leafwarp.run import CACHE_FOLDER

    leaf_cache.mkdir(exist_ok=True)
    (tmp_path / CACHE_FOLDER).symlink_to(leaf_cache, target_is_directory=True)
    return tmp_path
