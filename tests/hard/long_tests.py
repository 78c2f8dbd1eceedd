"""Tests that the gate leaves out, those with the marker `stability`: `python tests/hard/long_tests.py FOLDER`.

The table (test, failed, seconds) is stored as FOLDER/long_tests.csv. Exit code 1: a test failed, or there was none.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pandas
import pytest

ROOT = Path(__file__).resolve().parents[2]


class Outcomes:
    """pytest plugin: a row a test; an error in its set-up counts as a failure."""

    def __init__(self) -> None:
        self.rows: dict[str, dict[str, object]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the outcome of a test's call, and a failure of its set-up or tear-down."""
        if report.when == "call" or report.failed:
            row = {"test": report.nodeid, "failed": int(report.failed), "seconds": round(report.duration, 1)}
            self.rows[report.nodeid] = row


def main(folder: Path, select: str = "stability") -> int:
    """Run the tests of that marker; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    table, outcomes = folder.resolve() / "long_tests.csv", Outcomes()
    os.chdir(ROOT)
    code = pytest.main(["-m", select, "-p", "no:cacheprovider"], plugins=[outcomes])
    pandas.DataFrame(list(outcomes.rows.values()), columns=["test", "failed", "seconds"]).to_csv(table, index=False)
    return 0 if code == pytest.ExitCode.OK else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
