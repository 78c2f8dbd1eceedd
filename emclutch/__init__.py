"""emclutch: torque of electromagnetic particle clutches and brakes.

The face of the workbench; the physics lives in the packages `geometry`, `field`, `particles` and `coupling`,
which are also attributes of this one.
"""

from emclutch.siblings import check_siblings

check_siblings()

from emclutch.case import Case, load_case  # noqa: E402 (the guard comes first)
from emclutch.faults import SceneError  # noqa: E402
from emclutch.lazily import lazy_attributes  # noqa: E402

__version__ = "0.1.0"
__all__ = [
    "Case",
    "OutputError",
    "RunError",
    "SceneError",
    "accuracy",
    "coupling",
    "field",
    "geometry",
    "load_case",
    "load_result",
    "load_study",
    "particles",
    "run",
    "sweep",
]

# what imports numba, gmsh or matplotlib is imported when it is first asked for: `import emclutch` stays quick
__getattr__, __dir__ = lazy_attributes(
    __name__,
    {
        "run": "emclutch.run_case:run",
        "sweep": "emclutch.run_study:sweep",
        "accuracy": "emclutch.price_tag:accuracy",
        "OutputError": "emclutch.results:OutputError",
        "RunError": "emclutch.run_case:RunError",
        "load_result": "emclutch.results:load_result",
        "load_study": "emclutch.scene.study:load_study",
        "geometry": "geometry",
        "field": "field",
        "particles": "particles",
        "coupling": "coupling",
    },
)
