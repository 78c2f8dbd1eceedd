"""Results on disk, statistics and pictures: everything that stands in a run's folder."""

from emclutch.results.columns import COLUMNS
from emclutch.results.errors import OutputError
from emclutch.results.history import HistoryWriter, read_history
from emclutch.results.progress import Progress
from emclutch.results.result import Result, load_result
from emclutch.results.run_folder import RunFolder
from emclutch.results.statistics import Estimate, steady_mean

__all__ = [
    "COLUMNS",
    "Estimate",
    "HistoryWriter",
    "OutputError",
    "Progress",
    "Result",
    "RunFolder",
    "load_result",
    "read_history",
    "steady_mean",
]
