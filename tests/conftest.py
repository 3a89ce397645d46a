"""Devices, precisions and debug mode of the whole suite."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", action="append", default=[], help="Warp device to test on; repeatable (default: cpu)")
    parser.addoption("--debug-kernels", action="store_true", help="compile kernels with bounds checks")


def pytest_configure(config: pytest.Config) -> None:
    import warp as wp

    wp.config.quiet = True
    if config.getoption("--debug-kernels"):
        wp.config.mode = "debug"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", metafunc.config.getoption("--device") or ["cpu"])
    if "precision" in metafunc.fixturenames:
        metafunc.parametrize("precision", ["float32", "float64"])
