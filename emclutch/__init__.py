"""emclutch: torque of electromagnetic particle clutches and brakes.

The face of the workbench: a function for each command, with the same errors. The physics lives in the packages
`geometry`, `field`, `particles` and `coupling`, which are imported by their own names (`emclutch.field` is the function
that solves a scene's field).
"""

from typing import TYPE_CHECKING

from emclutch.siblings import check_siblings

check_siblings()

from emclutch.lazily import lazy_attributes  # noqa: E402 (the guard comes first)

if TYPE_CHECKING:  # the same names for type checkers and editors, which do not see the table below
    from emclutch.results import OutputError, Result, load_result
    from emclutch.results.errors import RunError
    from emclutch.results.study_result import StudyResult, load_study
    from emclutch.scene.case import Case, load_case
    from emclutch.scene.errors import SceneError
    from emclutch.scene.study import read_study
    from emclutch.simulation.check import Checked, check
    from emclutch.simulation.plan import Plan, plan
    from emclutch.simulation.window_state import CallbackError, WindowState
    from emclutch.studies.accuracy.effect_contributions import EffectsResult, effect_contributions
    from emclutch.studies.accuracy.study import accuracy
    from emclutch.studies.accuracy.target import run
    from emclutch.studies.design_search import DesignResult, design
    from emclutch.studies.field_result import FieldResult, field
    from emclutch.studies.field_transient import TransientResult, field_transient
    from emclutch.studies.fit import FitResult, fit
    from emclutch.studies.heat import HeatResult, heat
    from emclutch.studies.mesh import MeshedScene, mesh
    from emclutch.studies.powder_law import PowderLawResult, powder_law
    from emclutch.studies.sweep import collect, sweep
    from emclutch.studies.torque_map import MapResult, map

__version__ = "0.1.0"
__all__ = [
    "CallbackError",
    "Case",
    "Checked",
    "DesignResult",
    "EffectsResult",
    "FieldResult",
    "FitResult",
    "HeatResult",
    "MapResult",
    "MeshedScene",
    "OutputError",
    "Plan",
    "PowderLawResult",
    "Result",
    "RunError",
    "SceneError",
    "StudyResult",
    "TransientResult",
    "WindowState",
    "accuracy",
    "check",
    "collect",
    "design",
    "effect_contributions",
    "field",
    "field_transient",
    "fit",
    "heat",
    "load_case",
    "load_result",
    "load_study",
    "map",
    "mesh",
    "plan",
    "powder_law",
    "read_study",
    "run",
    "sweep",
]

# imported when it is first asked for: `import emclutch` and the help of every command stay quick
__getattr__, __dir__ = lazy_attributes(
    __name__,
    {
        "run": "emclutch.studies.accuracy.target:run",
        "WindowState": "emclutch.simulation.window_state:WindowState",
        "CallbackError": "emclutch.simulation.window_state:CallbackError",
        "check": "emclutch.simulation.check:check",
        "Checked": "emclutch.simulation.check:Checked",
        "plan": "emclutch.simulation.plan:plan",
        "Plan": "emclutch.simulation.plan:Plan",
        "field": "emclutch.studies.field_result:field",
        "FieldResult": "emclutch.studies.field_result:FieldResult",
        "field_transient": "emclutch.studies.field_transient:field_transient",
        "TransientResult": "emclutch.studies.field_transient:TransientResult",
        "fit": "emclutch.studies.fit:fit",
        "FitResult": "emclutch.studies.fit:FitResult",
        "heat": "emclutch.studies.heat:heat",
        "HeatResult": "emclutch.studies.heat:HeatResult",
        "mesh": "emclutch.studies.mesh:mesh",
        "MeshedScene": "emclutch.studies.mesh:MeshedScene",
        "sweep": "emclutch.studies.sweep:sweep",
        "collect": "emclutch.studies.sweep:collect",
        "design": "emclutch.studies.design_search:design",
        "DesignResult": "emclutch.studies.design_search:DesignResult",
        "powder_law": "emclutch.studies.powder_law:powder_law",
        "PowderLawResult": "emclutch.studies.powder_law:PowderLawResult",
        "map": "emclutch.studies.torque_map:map",
        "MapResult": "emclutch.studies.torque_map:MapResult",
        "accuracy": "emclutch.studies.accuracy.study:accuracy",
        "effect_contributions": "emclutch.studies.accuracy.effect_contributions:effect_contributions",
        "EffectsResult": "emclutch.studies.accuracy.effect_contributions:EffectsResult",
        "OutputError": "emclutch.results:OutputError",
        "RunError": "emclutch.results.errors:RunError",
        "Result": "emclutch.results:Result",
        "load_result": "emclutch.results:load_result",
        "StudyResult": "emclutch.results.study_result:StudyResult",
        "load_study": "emclutch.results.study_result:load_study",
        "Case": "emclutch.scene.case:Case",
        "load_case": "emclutch.scene.case:load_case",
        "SceneError": "emclutch.scene.errors:SceneError",
        "read_study": "emclutch.scene.study:read_study",
    },
    checks_names=True,
)
