"""Rows of the history for a coil in a window; each kind of source has its own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CoilRow:
    """A coil with a given current; all of one instant, that of the field's solve (`SolvedCoilField.window_part`).

    Attributes
    ----------
    current : float
        [A]
    flux_linkage : float
        Of all turns [Wb].
    field_energy : float
        [J]
    """

    current: float
    flux_linkage: float
    field_energy: float


@dataclass(frozen=True, slots=True)
class HysteresisRow(CoilRow):
    """A coil in steel with hysteresis.

    Attributes
    ----------
    hysteresis_loss : float
        Heat of the steel in the field's step that ends with the window [J].
    """

    hysteresis_loss: float


@dataclass(frozen=True, slots=True)
class CircuitRow(CoilRow):
    """A coil behind a resistance, at the window's end; energies in the window [J].

    Attributes
    ----------
    coil_voltage : float
        Its resistance included, at the window's end [V].
    coil_supplied, copper_loss, into_field : float
        What the supply gave, and what of it heats the winding and goes into the field.
    """

    coil_voltage: float
    coil_supplied: float
    copper_loss: float
    into_field: float


@dataclass(frozen=True, slots=True)
class EddyRow(CoilRow):
    """A coil near conductors; energies of the field's steps that end in the window [J].

    Attributes
    ----------
    coil_supplied, eddy_loss : float
        What the supply gave, and what of it heats the conductors.
    """

    coil_supplied: float
    eddy_loss: float


@dataclass(frozen=True, slots=True)
class VoltageEddyRow(EddyRow):
    """The same, driven by a voltage.

    Attributes
    ----------
    coil_voltage : float
        Its resistance included, at the window's end [V].
    copper_loss : float
        Part of `coil_supplied` that heats the winding [J].
    """

    coil_voltage: float
    copper_loss: float
