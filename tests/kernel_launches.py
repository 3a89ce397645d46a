"""Which tests launch kernels in the process of the suite: what --launching goes by."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import warp as wp

NOTED = "leafwarp/tests_without_kernels"
COUNT = "launches"


class KernelLaunches:
    """Notes in pytest's cache, as tests pass, which of them launched no kernel; leaves these out where asked to.

    What launches a kernel in a fixture that tests share counts for the test that needed it first: all launches of a run
    are made again by the tests that are not left out. A test that never ran, or did not pass, is not left out.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._cache = config.cache
        self._only = config.getoption("--launching")
        # The checked run follows what the other has noted, and notes nothing; workers report to the main process.
        self._notes = not config.getoption("--debug-kernels") and not hasattr(config, "workerinput")
        self._count = 0
        self._launches: dict[str, int] = {}
        self._watch()

    def _watch(self) -> None:
        launch, run, replay = wp.launch, wp.Launch.launch, wp.capture_launch

        def counted_launch(*arguments, record_cmd: bool = False, **options):
            self._count += not record_cmd
            return launch(*arguments, record_cmd=record_cmd, **options)

        def counted_run(command: wp.Launch, *arguments, **options):
            self._count += 1
            return run(command, *arguments, **options)

        def counted_replay(*arguments, **options):
            self._count += 1
            return replay(*arguments, **options)

        wp.launch, wp.Launch.launch, wp.capture_launch = counted_launch, counted_run, counted_replay

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        if not self._only:
            return
        without = set(self._cache.get(NOTED, []))
        left_out = [item for item in items if item.nodeid in without]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item.nodeid not in without]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Iterator[None]:
        self._count = 0
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        result = yield
        item.user_properties.append((COUNT, self._count))
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self._launches[report.nodeid] = dict(report.user_properties)[COUNT]

    def pytest_sessionfinish(self) -> None:
        if self._notes and self._launches:
            earlier = set(self._cache.get(NOTED, [])) - set(self._launches)
            self._cache.set(NOTED, sorted(earlier | {test for test, count in self._launches.items() if not count}))
