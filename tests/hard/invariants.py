"""What must hold in a hard scene, whatever happens in it: each invariant is a function that returns a margin.

A margin is what was measured over what is allowed: below 1 it holds. The bounds are data, in
``cases/hard/invariants.toml``. An energy balance adds its error up over all windows, a torque balance is of each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, pi

import numpy as np
from finished_run import FinishedRun
from scipy.spatial import cKDTree

Invariant = Callable[[FinishedRun, object], float]


def margins(run: FinishedRun, bounds: Mapping[str, object]) -> dict[str, float]:
    """Margin of every invariant that the bounds name."""
    return {name: INVARIANTS[name](run, bound) for name, bound in bounds.items()}


def step_error(run: FinishedRun) -> float:
    """Fraction of its energy that an impact may lose or gain by DEM, (pi/n)^2/4 at n steps a contact.

    A step of v dt in whose midst grains meet takes the work of their spring k by the trapezoid rule, which misses at
    most k (v dt)^2/8: of m v^2/2 the fraction (omega dt)^2/4, where omega dt = pi/n, n steps being half a period.
    """
    return 0.25 * (pi / run.case.scene.time.steps_per_contact) ** 2


def finite(run: FinishedRun, _: object) -> float:
    """Every number of the history and of the last state is one; the inertial number is undefined without a torque."""
    numbers = run.history.drop(columns="inertial_number", errors="ignore").to_numpy()
    arrays = (numbers, run.position, run.velocity, run.moment)
    return 0.0 if all(np.isfinite(array).all() for array in arrays) else inf


def grains_kept(run: FinishedRun, share: float) -> float:
    """As many grains as at the start, each once, none deeper in a wall than `share` of its radius."""
    if len(np.unique(run.ids)) != len(run.ids) or len(run.ids) != run.summary["grains"]:
        return inf
    return float(run.into_walls().max()) / share


def overlap(run: FinishedRun, most: float) -> float:
    """Largest overlap over the diameter."""
    return float(run.history["max_overlap"].max()) / most


def speed(run: FinishedRun, most: float) -> float:
    """Largest speed of a grain [m/s]."""
    return float(run.history["max_speed"].max()) / most


def stored_energy(run: FinishedRun, most: float) -> float:
    """Kinetic and elastic energy over what was there and what walls, field and weight have put in until then."""
    stored, put_in = _stored(run), np.cumsum(np.maximum(_work(run), 0.0)) + _stored_at_start(run)
    return float(np.max(stored / np.maximum(put_in, 1e-300))) / most


def energy_balance(run: FinishedRun, share: float | str) -> float:
    """What the energy budget leaves open, over all that went through them."""
    return float(np.abs(np.cumsum(run.sum_of("energy_residual"))).max()) / (_share(run, share) * energy_through(run))


def losses(run: FinishedRun, share: float) -> float:
    """No mechanism gives energy back: the most negative loss of a window over all losses."""
    worst = abs(float(run.history.filter(like="dissipated").to_numpy().min(initial=0.0)))
    return worst / (share * energy_through(run))


def torque_balance(run: FinishedRun, share: float) -> float:
    """What the torques and dL/dt leave open in a window, over the largest sum of their sizes."""
    return float(run.history["torque_residual"].abs().max()) / (share * torque_scale(run))


def residuals(run: FinishedRun, factor: float) -> float:
    """Field, moments, feedback and rigid contacts reached the tolerances that the scene asks for."""
    scene, history = run.case.scene, run.history
    found = []
    if "field_residual" in history:
        found.append(history["field_residual"].max() / scene.field.newton_tolerance)
    if "moment_residual" in history:
        found.append(history["moment_residual"].max() / scene.effects.dipoles.tolerance)
    if "feedback_residual" in history:
        found.append(history["feedback_residual"].max() / run.summary["feedback"]["tolerance"])
    if "missed_steps" in history:
        missed = history["missed_steps"].sum() / history["steps"].sum()
        found.append(missed / max(scene.contact.dvi.allowed_misses, 1e-300))
    return float(max(found)) / factor


def magnetisation(run: FinishedRun, most: float) -> float:
    """The largest dipole part of a grain over its saturation, which it exceeds by the moments' tolerance at most.

    The flux that leaves through contacts is in addition to it.
    """
    volume, dipoles = 4.0 / 3.0 * pi * run.radius**3, run.case.scene.effects.dipoles
    allowed = most * run.case.scene.particles.saturation * (1.0 + (0.0 if dipoles is None else dipoles.tolerance))
    return float((np.linalg.norm(run.dipole, axis=1) / volume).max()) / allowed


def magnetised(run: FinishedRun, least: float) -> float:
    """The mean magnetisation is at least this fraction of the saturation: what is to be hard about it was there."""
    volume = 4.0 / 3.0 * pi * run.radius**3
    mean = float((np.linalg.norm(run.moment, axis=1) / volume).mean()) / run.case.scene.particles.saturation
    return least / max(mean, 1e-300)


def field_gone(run: FinishedRun, most: float) -> float:
    """Without current the flux linkage, the field's torque and all moments are nothing at the end."""
    last, history = run.history.iloc[-1], run.history
    linkage = abs(last["flux_linkage"]) / max(history["flux_linkage"].abs().max(), 1e-300)
    torque = abs(last["torque_field"]) / max(history["torque_field"].abs().max(), 1e-300)
    volume = 4.0 / 3.0 * pi * run.radius**3
    left = float((np.linalg.norm(run.moment, axis=1) / volume).max()) / run.case.scene.particles.saturation
    return max(linkage, torque, left) / most


def field_torque(run: FinishedRun, share: float) -> float:
    """A field of revolution takes no torque: `torque_field` over the sum of the sizes of its parts."""
    parts = [name for name in run.history if name.startswith("torque_field_")]
    scale = run.history[parts].abs().sum(axis=1).max()
    return float(run.history["torque_field"].abs().max()) / (share * max(scale, 1e-300))


def current(run: FinishedRun, most: float) -> float:
    """The largest current [A]: what voltage and resistance allow."""
    return float(run.history["current"].abs().max()) / most


def coil_energy(run: FinishedRun, share: float) -> float:
    """What the supply gives is copper loss, eddy loss and the field's energy (and the little work on the grains).

    All are of the window's end, or of the field's last step.
    """
    flow = run.sum_of("coil_supplied") - run.sum_of("copper_loss", "eddy_loss")
    scale = np.abs(run.sum_of("coil_supplied")).sum() + run.history["field_energy"].max()
    return abs(flow.sum() - run.history["field_energy"].iloc[-1]) / (share * scale)


def flux_linkage(run: FinishedRun, bounds: list[float]) -> float:
    """Size of the largest flux linkage [Wb] between two bounds that follow from the magnetic circuit."""
    low, high = bounds
    most = float(run.history["flux_linkage"].abs().max())
    return max(low / max(most, 1e-300), most / high)


def odd_in_current(run: FinishedRun, share: float) -> float:
    """The flux linkage of the opposite current is the opposite one: last window against the first."""
    first, last = run.history["flux_linkage"].iloc[[0, -1]]
    return abs(first + last) / (share * abs(first))


def frictionless(run: FinishedRun, most: float) -> float:
    """Without friction no contact has a tangential torque, and none is lost by sliding."""
    slid = run.sum_of("dissipated_sliding").sum() / max(run.sum_of("dissipated").sum(), 1e-300)
    tangential = np.abs(run.sum_of("torque_disc_tangential")).max()
    return float(max(slid, tangential / torque_scale(run))) / most


def shaft_momentum(run: FinishedRun, share: float) -> float:
    """A free disc without load has the momentum that its torques gave: J (w_end - w_0) = sum of T dt.

    Round-off of the speed takes at most half a last bit of it a step: all that grains give to a shaft that is heavy
    enough.
    """
    free = run.case.scene.motion.disc.free
    gained = free.inertia * (run.history["disc_speed"].iloc[-1] - free.initial_speed)
    given = run.history["torque_disc"].to_numpy() * _durations(run)
    speed = float(run.history["disc_speed"].abs().max())
    round_off = 0.5 * np.finfo(float).eps * free.inertia * speed * run.summary["steps"]
    return abs(gained - given.sum()) / (share * np.abs(given).sum() + round_off)


def at_rest(run: FinishedRun, most: float) -> float:
    """Kinetic energy at the end over m g d of all grains."""
    mass = run.case.scene.particles.density * 4.0 / 3.0 * pi * run.radius**3
    return float(run.history["kinetic_energy"].iloc[-1]) / (most * float((mass * 9.81 * 2.0 * run.radius).sum()))


def kept_energy(run: FinishedRun, share: float | str) -> float:
    """Nothing is lost and nothing put in: kinetic and elastic energy stay what they were."""
    start = _stored_at_start(run)
    return float(np.abs(_stored(run) - start).max()) / (_share(run, share) * start)


def like_its_image(run: FinishedRun, rule: Mapping[str, object]) -> float:
    """The grains stand where their images do, mirrored (`mirror`: axes) or turned by `turn` [deg]; in diameters."""
    image = run.position.copy()
    for axis in rule.get("mirror", ()):
        image[:, "xyz".index(axis)] *= -1.0
    angle = np.radians(float(rule.get("turn", 0.0)))
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    away, _ = cKDTree(run.position).query(image @ turn.T)
    return float(away.max()) / (float(rule["within"]) * 2.0 * float(run.radius.max()))


def on_axis(run: FinishedRun, share: float) -> float:
    """Grains on the axis stay there: the largest distance over the radius."""
    return float((np.hypot(run.position[:, 0], run.position[:, 1]) / run.radius).max()) / share


INVARIANTS: dict[str, Invariant] = {
    law.__name__: law  # type: ignore[attr-defined]
    for law in (
        finite, grains_kept, overlap, speed, stored_energy, energy_balance, losses, torque_balance, residuals,
        magnetisation, magnetised, field_gone, field_torque, current, coil_energy, flux_linkage, odd_in_current,
        frictionless, shaft_momentum, at_rest, kept_energy, like_its_image, on_axis,
    )
}  # fmt: skip


def energy_through(run: FinishedRun) -> float:
    """Energy that went through the energy budget [J]: work, losses and what is stored at most."""
    through = np.abs(_work(run)).sum() + run.sum_of("dissipated").sum() + _stored(run).max()
    return max(float(through), 1e-300)


def torque_scale(run: FinishedRun) -> float:
    """Largest sum of the sizes of all torques and of dL/dt in a window [N m].

    Where all are nothing but round-off it is a millionth of the grains' largest angular momentum, given in a window.
    """
    names = [name for name in ("torque_disc", "torque_rotor", "torque_housing", "torque_field") if name in run.history]
    momentum = run.history["angular_momentum"].to_numpy()
    change = np.diff(momentum, prepend=momentum[0]) / _durations(run)
    terms = run.history[names].abs().sum(axis=1).to_numpy() + np.abs(change)
    return max(float(terms.max()), 1e-6 * _inertial_torque(run))


def _share(run: FinishedRun, bound: float | str) -> float:
    """A fraction that the scene gives as a number, or as "step": that of `step_error`."""
    return step_error(run) if isinstance(bound, str) else bound


def _durations(run: FinishedRun) -> np.ndarray:
    return np.diff(run.history["time"].to_numpy(), prepend=0.0)


def _work(run: FinishedRun) -> np.ndarray:
    return run.sum_of("work_walls", "work_magnetic", "work_gravity")


def _stored(run: FinishedRun) -> np.ndarray:
    return run.sum_of("kinetic_energy", "elastic_energy")


def _stored_at_start(run: FinishedRun) -> float:
    """Before the first window, from its energy budget."""
    change = (_work(run) - run.sum_of("dissipated", "energy_residual"))[0]
    return max(float(_stored(run)[0] - change), 0.0)


def _inertial_torque(run: FinishedRun) -> float:
    """Largest m v r over a window [N m]: what torques are measured by where symmetry leaves none."""
    mass = run.case.scene.particles.density * 4.0 / 3.0 * pi * (run.radius**3).sum()
    reach = np.hypot(run.position[:, 0], run.position[:, 1]).max() + run.radius.max()
    n = run.case.scene.particles.n_sectors
    return float(n * mass * reach * (run.history["max_speed"] / _durations(run)).max())
