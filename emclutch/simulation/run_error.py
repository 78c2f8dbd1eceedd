"""Errors that end a run without a result."""


class RunError(RuntimeError):
    """The run failed for a reason of physics or numerics; the message says which and what to do."""


class Interrupted(RunError):
    """The user stopped the run; a checkpoint lies in its folder."""
