"""Concrete kernels of one precision, and the arrays and recorded launches of one simulation."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from leafwarp.errors import InputError
from leafwarp_kernels.lanes import LANES, Lanes

wp.config.log_level = wp.LOG_WARNING

REAL = {"float32": wp.float32, "float64": wp.float64}
VECTOR = {"float32": wp.vec3f, "float64": wp.vec3d}
LANE_VECTOR = {precision: wp.types.vector(LANES, real) for precision, real in REAL.items()}


def specialise(kernel: wp.Kernel, precision: str) -> wp.Kernel:
    """The overload of a generic kernel for one precision.

    In a kernel's signature ``wp.Float`` stands for a scalar of the scene's precision, ``Any`` for a 3-vector and
    ``Lanes`` for a block of it. Only the overloads asked for here are ever compiled.

    Args:
        kernel: A kernel of :mod:`leafwarp_kernels`.
        precision: "float32" or "float64".
    """
    concrete = {wp.Float: REAL[precision], Any: VECTOR[precision], Lanes: LANE_VECTOR[precision]}
    types = {}
    for argument in kernel.adj.args:
        annotated = argument.type
        if hasattr(annotated, "ndim"):
            if annotated.dtype in concrete:
                types[argument.label] = wp.array(dtype=concrete[annotated.dtype], ndim=annotated.ndim)
        elif annotated in concrete:
            types[argument.label] = concrete[annotated]
    return wp.overload(kernel, types) if types else kernel


def check_device(device: str) -> str:
    """The name of a Warp device.

    Raises:
        InputError: There is no such device here.
    """
    try:
        if device == "cuda" and not wp.is_cuda_available():  # Warp would ask a driver that is not there
            raise ValueError
        return wp.get_device(device).alias
    except (RuntimeError, ValueError):
        known = ", ".join(d.alias for d in wp.get_devices())
        raise InputError(f"--device {device}: no such device; accepted here: {known}") from None


def padded_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of whole blocks of lanes that holds a list or a map.

    The number of blocks in a row is odd: with a power of two the cells of a column would share a few places in the
    processor's cache.
    """
    if len(shape) == 1:
        return (LANES * -(-shape[0] // LANES),)
    rows, columns = (-(-count // LANES) for count in shape)
    return LANES * rows, LANES * (columns | 1)


@dataclass(frozen=True)
class ArraySpec:
    """An array that a stage brings into the state.

    Attributes:
        name: Its name in the state.
        shape: Its shape.
        kind: "real" (the scene's precision), "vector" (3-vector of it), "int32", "bool" or "float64".
        meaning: What it holds, with its unit.
        padded: The array is part of a larger one of whole blocks of lanes, which kernels that work on blocks see
            (:meth:`State.whole`, :meth:`State.lanes`). One or two
            dimensions.
    """

    name: str
    shape: tuple[int, ...]
    kind: str
    meaning: str
    padded: bool = False

    @property
    def allocated_shape(self) -> tuple[int, ...]:
        """The shape in memory."""
        return padded_shape(self.shape) if self.padded else self.shape

    @property
    def margin(self) -> int:
        """Elements before and after the array that can be read, but mean nothing: those of a displaced view."""
        return LANES if self.padded else 0

    def dtype(self, precision: str) -> Any:
        """The Warp type of an element."""
        fixed = {"int32": wp.int32, "bool": wp.bool, "float64": wp.float64}
        return fixed.get(self.kind) or (REAL if self.kind == "real" else VECTOR)[precision]

    def numpy_dtype(self, precision: str) -> np.dtype:
        """The NumPy type of a component of an element."""
        return np.dtype(precision if self.kind in ("real", "vector") else self.kind)

    def byte_count(self, precision: str) -> int:
        """Memory that the array takes [byte]."""
        count = int(np.prod(self.allocated_shape)) + 2 * self.margin
        return count * wp.types.type_size_in_bytes(self.dtype(precision))


class State:
    """The arrays of one simulation, by name, and the count of what was launched on them.

    Args:
        specs: Every array to allocate, zeroed. Nothing else is ever allocated for the simulation.
        device: Warp device such as "cpu" or "cuda:0".
        precision: "float32" or "float64".
    """

    def __init__(self, specs: Iterable[ArraySpec], device: str, precision: str):
        self.device = wp.get_device(device)
        self.precision = precision
        self.real = REAL[precision]
        self.vector = VECTOR[precision]
        self.launch_count = 0
        self.recorded: list[Command] = []
        self._arrays: dict[str, wp.array] = {}
        self._memory: dict[str, wp.array] = {}
        self._whole: dict[str, wp.array] = {}
        self._component: dict[str, np.dtype] = {}
        for spec in specs:
            self.add(spec)

    def add(self, spec: ArraySpec) -> None:
        """Allocate an array, zeroed."""
        if spec.name in self._arrays:
            raise ValueError(f"array '{spec.name}' is declared twice")
        dtype, shape = spec.dtype(self.precision), spec.allocated_shape
        memory = wp.zeros(int(np.prod(shape)) + 2 * spec.margin, dtype=dtype, device=self.device)
        whole = (memory[spec.margin : -spec.margin] if spec.margin else memory).reshape(shape)
        self._memory[spec.name] = memory
        self._whole[spec.name] = whole
        self._arrays[spec.name] = whole[tuple(map(slice, spec.shape))] if spec.padded else whole
        self._component[spec.name] = spec.numpy_dtype(self.precision)

    def __getitem__(self, name: str) -> wp.array:
        return self._arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    @property
    def many_threads(self) -> bool:
        """Whether a launch runs many threads at a time, as on a GPU; a CPU runs them one after another."""
        return self.device.is_cuda

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all arrays."""
        return tuple(self._arrays)

    @property
    def byte_count(self) -> int:
        """Memory of all arrays [byte]."""
        return sum(memory.capacity for memory in self._memory.values())

    def whole(self, name: str) -> wp.array:
        """An array with its padding."""
        return self._whole[name]

    def lanes(self, name: str, displaced: int = 0) -> wp.array:
        """An array with its padding as blocks of lanes along its last axis.

        Args:
            name: Name of a padded array.
            displaced: Elements by which all blocks are displaced: with 1 each holds the right neighbours of its own,
                with -1 the left ones. What lies beyond the end of a row means nothing.
        """
        whole = self._whole[name]
        block = LANE_VECTOR[self.precision]
        size = wp.types.type_size_in_bytes(block)
        return wp.array(
            ptr=whole.ptr + displaced * (size // LANES),
            dtype=block,
            shape=(*whole.shape[:-1], whole.shape[-1] // LANES),
            strides=(*whole.strides[:-1], size),
            device=self.device,
        )

    def upload(self, name: str, values: np.ndarray) -> None:
        """Fill an array from the host, converted to its type."""
        self._arrays[name].assign(np.ascontiguousarray(values, dtype=self._component[name]))

    def record(
        self, kernel: wp.Kernel, dim: int | Sequence[int], inputs: Sequence[Any], outputs: Sequence[Any]
    ) -> Command:
        """Record a launch of a kernel's overload for this state's precision; nothing runs yet.

        Arguments may be names of arrays of this state.
        """
        resolved = [self._arrays[a] if isinstance(a, str) else a for a in (*inputs, *outputs)]
        launch = wp.launch(
            specialise(kernel, self.precision), dim=dim, inputs=resolved, device=self.device, record_cmd=True
        )
        names = [self._name_of(argument) for argument in resolved]
        reads = tuple(name for name in names[: len(inputs)] if name is not None)
        writes = tuple(name for name in names[len(inputs) :] if name is not None)
        # The state holds its commands. If they held it, too, its arrays would stay until the garbage collector came by,
        # which knows nothing of a GPU's memory.
        command = Command(weakref.proxy(self), launch, f"{kernel.module.name}.{kernel.key}", reads, writes)
        self.recorded.append(command)
        return command

    def _name_of(self, argument: Any) -> str | None:
        """Name of the array that an argument is, or is a view of."""
        if not isinstance(argument, wp.array):
            return None
        for name, memory in self._memory.items():
            if argument.ptr is not None and memory.ptr is not None and 0 <= argument.ptr - memory.ptr < memory.capacity:
                return name
        return None


class PartOfState:
    """A state within a state: its arrays have names of their own, and all else is shared.

    A stage bound to it cannot tell it from a state.

    Args:
        state: The state.
        prefix: What names of arrays begin with in the state, and not in this part.
    """

    def __init__(self, state: State, prefix: str):
        self._state = state
        self._prefix = prefix

    def __getattr__(self, name: str) -> Any:
        return getattr(self._state, name)

    def __getitem__(self, name: str) -> wp.array:
        return self._state[self._prefix + name]

    def __contains__(self, name: str) -> bool:
        return self._prefix + name in self._state

    @property
    def launch_count(self) -> int:
        """Of the whole state."""
        return self._state.launch_count

    @launch_count.setter
    def launch_count(self, count: int) -> None:
        self._state.launch_count = count

    def add(self, spec: ArraySpec) -> None:
        """Like :meth:`State.add`."""
        self._state.add(replace(spec, name=self._prefix + spec.name))

    def whole(self, name: str) -> wp.array:
        """Like :meth:`State.whole`."""
        return self._state.whole(self._prefix + name)

    def lanes(self, name: str, displaced: int = 0) -> wp.array:
        """Like :meth:`State.lanes`."""
        return self._state.lanes(self._prefix + name, displaced)

    def upload(self, name: str, values: np.ndarray) -> None:
        """Like :meth:`State.upload`."""
        self._state.upload(self._prefix + name, values)

    def record(
        self, kernel: wp.Kernel, dim: int | Sequence[int], inputs: Sequence[Any], outputs: Sequence[Any]
    ) -> Command:
        """Like :meth:`State.record`."""
        own = [[self[a] if isinstance(a, str) else a for a in arguments] for arguments in (inputs, outputs)]
        return self._state.record(kernel, dim, *own)


@dataclass
class Command:
    """A recorded launch, counted in its state when it runs.

    Attributes:
        state: The state, which has to live as long as the command is run.
        launch: The launch.
        kernel_name: Module and name of the kernel.
        reads: Names of the arrays among its inputs.
        writes: Names of the arrays among its outputs.
    """

    state: State
    launch: wp.Launch
    kernel_name: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]

    def run(self) -> None:
        self.launch.launch()
        self.state.launch_count += 1
