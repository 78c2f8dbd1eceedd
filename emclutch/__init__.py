"""emclutch: torque of electromagnetic particle clutches and brakes.

The face of the workbench: a function for each command, with the same errors. The physics lives in the packages
`geometry`, `field`, `particles` and `coupling`, which are imported by their own names (`emclutch.field` is the function
that solves a scene's field).
"""

from typing import TYPE_CHECKING

from emclutch.siblings import check_siblings

check_siblings()

from emclutch.case import Case, load_case  # noqa: E402 (the guard comes first)
from emclutch.faults import SceneError  # noqa: E402
from emclutch.lazily import lazy_attributes  # noqa: E402

if TYPE_CHECKING:  # the same names for type checkers and editors, which do not see the table below
    from emclutch.design_search import DesignResult, design
    from emclutch.field_result import FieldResult, field
    from emclutch.mesh_command import MeshedScene, mesh
    from emclutch.price_tag import accuracy
    from emclutch.results import OutputError, Result, load_result
    from emclutch.results.study_result import StudyResult, load_study
    from emclutch.run_case import RunError, run
    from emclutch.run_plan import Checked, Plan, check, plan
    from emclutch.run_study import sweep
    from emclutch.scene.study import read_study
    from emclutch.window_state import CallbackError, WindowState

__version__ = "0.1.0"
__all__ = [
    "CallbackError",
    "Case",
    "Checked",
    "DesignResult",
    "FieldResult",
    "MeshedScene",
    "OutputError",
    "Plan",
    "Result",
    "RunError",
    "SceneError",
    "StudyResult",
    "WindowState",
    "accuracy",
    "check",
    "design",
    "field",
    "load_case",
    "load_result",
    "load_study",
    "mesh",
    "plan",
    "read_study",
    "run",
    "sweep",
]

# what imports numba, gmsh or matplotlib is imported when it is first asked for: `import emclutch` stays quick
__getattr__, __dir__ = lazy_attributes(
    __name__,
    {
        "run": "emclutch.run_case:run",
        "WindowState": "emclutch.window_state:WindowState",
        "CallbackError": "emclutch.window_state:CallbackError",
        "check": "emclutch.run_plan:check",
        "Checked": "emclutch.run_plan:Checked",
        "plan": "emclutch.run_plan:plan",
        "Plan": "emclutch.run_plan:Plan",
        "field": "emclutch.field_result:field",
        "FieldResult": "emclutch.field_result:FieldResult",
        "mesh": "emclutch.mesh_command:mesh",
        "MeshedScene": "emclutch.mesh_command:MeshedScene",
        "sweep": "emclutch.run_study:sweep",
        "design": "emclutch.design_search:design",
        "DesignResult": "emclutch.design_search:DesignResult",
        "accuracy": "emclutch.price_tag:accuracy",
        "OutputError": "emclutch.results:OutputError",
        "RunError": "emclutch.run_case:RunError",
        "Result": "emclutch.results:Result",
        "load_result": "emclutch.results:load_result",
        "StudyResult": "emclutch.results.study_result:StudyResult",
        "load_study": "emclutch.results.study_result:load_study",
        "read_study": "emclutch.scene.study:read_study",
    },
)
