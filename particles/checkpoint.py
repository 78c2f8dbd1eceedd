"""Common part of the checkpoints of both engines: grains, bodies, held force, list of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from particles.bodies import Body
from particles.grains import RECORDS, Grains

OF_THE_LIST = "list_"  # before the names of the list's arrays


def taken(
    grains: Grains, bodies: Sequence[Body], contacts: Mapping[str, np.ndarray], **held: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Copies of all of it, of the list by its ``contacts`` and of what is ``held`` by its name, unless it is None."""
    arrays = {name: getattr(grains, name).copy() for name in RECORDS}
    for name, value in ({"magnetic_moment": grains.magnetic_moment} | held).items():
        if value is not None:
            arrays[name] = value.copy()
    arrays |= {f"{OF_THE_LIST}{name}": value.copy() for name, value in contacts.items()}
    arrays["bodies"] = np.array([[b.angle, b.speed, b.external_torque] for b in bodies]).reshape(-1, 3)
    return arrays


def put_grains(state: Mapping[str, np.ndarray], grains: Grains) -> None:
    """Give grains the arrays of a state."""
    for name in RECORDS:
        setattr(grains, name, state[name].copy())
    grains.magnetic_moment = held_in(state, "magnetic_moment")


def put_bodies(state: Mapping[str, np.ndarray], bodies: Sequence[Body]) -> None:
    """Give bodies the angles [rad], speeds [rad/s] and external torques [N m] of a state."""
    for body, (angle, speed, torque) in zip(bodies, state["bodies"], strict=True):
        body.angle, body.speed, body.external_torque = float(angle), float(speed), float(torque)


def held_in(state: Mapping[str, np.ndarray], name: str) -> np.ndarray | None:
    """A copy of an array that a state may have."""
    value = state.get(name)
    return None if value is None else value.copy()


def list_of(state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The list's arrays of a state, by their own names."""
    return {name.removeprefix(OF_THE_LIST): value for name, value in state.items() if name.startswith(OF_THE_LIST)}


def refuse_another_scene(engine: str, state: Mapping[str, np.ndarray], grains: Grains, bodies: Sequence[Body]) -> None:
    """A ValueError where the state has another number of grains or bodies than the ``engine``."""
    if len(state["mass"]) != grains.count or len(state["bodies"]) != len(bodies):
        raise ValueError(
            f"the state has {len(state['mass'])} grains and {len(state['bodies'])} bodies, this {engine} "
            f"{grains.count} and {len(bodies)}; restore it into the scene that it came from"
        )
