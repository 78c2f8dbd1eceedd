"""Results on disk, statistics and pictures: everything that stands in a run's folder."""

from typing import TYPE_CHECKING

from emclutch.lazily import lazy_attributes

if TYPE_CHECKING:  # as in emclutch
    from emclutch.results.column_table import COLUMNS
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

# errors and the clock need neither numpy nor numba, which the others import
__getattr__, __dir__ = lazy_attributes(
    __name__,
    {
        "COLUMNS": "emclutch.results.column_table:COLUMNS",
        "OutputError": "emclutch.results.errors:OutputError",
        "HistoryWriter": "emclutch.results.history:HistoryWriter",
        "read_history": "emclutch.results.history:read_history",
        "Progress": "emclutch.results.progress:Progress",
        "Result": "emclutch.results.result:Result",
        "load_result": "emclutch.results.result:load_result",
        "RunFolder": "emclutch.results.run_folder:RunFolder",
        "Estimate": "emclutch.results.statistics:Estimate",
        "steady_mean": "emclutch.results.statistics:steady_mean",
    },
)
