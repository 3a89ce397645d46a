"""The errors a user may meet, each with the exit code of the command line."""

from __future__ import annotations


class LeafwarpError(Exception):
    """Base of every error that is reported as one line, without a traceback."""

    exit_code = 1


class InputError(LeafwarpError):
    """A bad argument, scene or image. The message names file, key, value and what is accepted."""

    exit_code = 2


class SimulationError(LeafwarpError):
    """The simulation cannot go on. Frames already written are kept.

    Args:
        frame: Number of the frame that failed.
        stage: Name of the stage that failed.
        reason: What was found and what would help.
    """

    exit_code = 1

    def __init__(self, frame: int, stage: str, reason: str):
        super().__init__(f"frame {frame}: {stage}: {reason}")
        self.frame = frame
        self.stage = stage
        self.reason = reason


class OutputError(LeafwarpError):
    """A result could not be written (disk full, folder gone). Frames already written are kept."""

    exit_code = 1
