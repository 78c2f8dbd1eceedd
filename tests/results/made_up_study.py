"""Accuracy studies of made-up numbers, for the code that reads them."""

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, MeasuredValue
from emclutch.scene.case import case_from
from emclutch.settings import settings_of

CELL = {
    "scene": {"title": "sheared annulus", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 1e-3},
    "field": {"source": "uniform", "field_strength": "300 kA/m", "direction": "radial"},
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.45, "sector": "20 deg"},
    "motion": {"rotor": {"speed": "6000 rpm"}, "disc": {"speed": 0.0}},
    "effects": {
        "magnetic_force": {},
        "dipoles": {"model": "mutual", "cutoff": 2.5, "update_every": 61},
        "saturation": {},
    },
    "contact": {"stiffness": "50 kN/m"},
    "time": {"end": "0.6 ms", "window": "20 us", "average_from": "0.2 ms"},
    "accuracy": {"replicas": 1},
    "output": {"snapshots": 0, "pictures": False, "formats": []},
}


def cell(**values):
    """The toy scene with other values, `time__end` for ``time.end``."""
    return case_from(CELL, {key.replace("__", "."): value for key, value in values.items()})


def contact_step(bias, half_width=0.0, own=20.0):
    """Three values that follow the second order, and are off by `bias` at 20 steps a contact."""
    error = half_width / 2.0
    values = [
        MeasuredValue(n, 1.0 / n, 2.0 * (1.0 + bias) ** ((20.0 / n) ** 2), error, 4, 3.0 * n / 20.0, n / 20.0)
        for n in (10, 20, 40)
    ]
    return MeasuredSetting("contact_step", "time.steps_per_contact", Basis.TORQUE, own, 2.0, 0.0, tuple(values), 30.0)


def without_error(case, plan, settings):
    """All other settings of a scene, measured with no effect of their values."""
    given = {one.name for one in settings}
    others = {one: float(one.own(case.scene, plan)) for one in settings_of(case.scene) if one.name not in given}
    return [
        MeasuredSetting(
            one.name, one.key, Basis.MOMENTS, own, None, 0.0,
            tuple(MeasuredValue(f * own, f * one.step_size(own), 5.0, 0.0, 1, 0.2, f) for f in (2.0, 1.0)),
        )
        for one, own in others.items()
    ]  # fmt: skip


def study(device, *settings, **values):
    """A study of a device with these settings."""
    given = {"torque": 2.0, "scatter": 0.1, "freedom": 30.0, "strain": 9.0, "replicas": 4, "seconds": 3.0,
             "drive": {}, "machine": {"date": "2026-01-01"}} | values  # fmt: skip
    return AccuracyStudy(device=device, case="made up", settings=settings, **given)
