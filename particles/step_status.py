"""Status of a compiled step to the engine that called it: all steps are done, or why it stopped earlier."""

DONE, REBUILD, NOT_FINITE, OVERLAP, TOO_FAST = range(5)
