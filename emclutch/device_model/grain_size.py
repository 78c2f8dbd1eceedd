"""Grains per gap: those of the scene, those of the powder that they stand for, and what differs.

Where grains stand for finer ones (`particles.stands_for`), their diameter is a numerical setting. At equal fill, field,
friction and shear rate nothing in the laws of dry magnetised grains has a length of its own: forces between dipoles and
in necks go with d^2, areas too, so that stresses do not depend on d; the smallest gap of necks is counted in radii, and
is that of the real grains. What does is

- the grains per gap: walls order the layers next to them, and a gap of few layers dilates as a whole;
- the inertial number I = gamma d sqrt(rho/p), which is smaller in the real powder by the ratio of the diameters;
- cohesion and fluid drag (`EffectSection.size_note`).

Where the law of the powder covers a scene, it has both (`ExpectedTorque.size_excess`). Elsewhere the torque over n
grains per gap holds the sum of the first two: T(n) = T_inf (1 + a/n^p), measured and extrapolated by studies over the
diameter (`emclutch.results.grain_size_law`, with the sources).

Diameters are means over the volume of the powder, to which each grain counts by its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene

COEFFICIENT, EXPONENT = (4.9, 4.0, 5.7), 2.0
"""a, with the ends of its 95 % interval, and p, of both shipped clutches on sectors as wide as the gap or wider
(docs/explanation/brake.md; `grain_size.coefficient` in docs/measured.csv)."""

MAX_EXCESS = 0.10
"""Torque of coarse grains over that of the real ones, less 1, from which on results warn."""

FINE = 16.0
"""Grains per gap of real powders at the least: 1 mm over some 60 um."""


@dataclass(frozen=True, slots=True)
class GrainSize:
    """Coarseness of the grains of a sheared, magnetised powder.

    Attributes
    ----------
    gap, diameter : float
        Width of the sheared gap, and mean diameter by volume of the scene's grains [m].
    count : int
        Grains of that size in the whole device.
    real_diameter : float or None
        Of the powder that they stand for [m]; None where the scene does not say.
    real_count : float
        Grains of the powder in the whole device.
    notes : tuple of str
        Effects of the scene whose stress depends on the size, in words.
    by_law : tuple of float or None
        Torque of these grains over that of the real ones, less 1, with its 95 % interval, by the law of the powder;
        None where it is a guess.
    """

    gap: float
    diameter: float
    count: int
    real_diameter: float | None
    real_count: float
    notes: tuple[str, ...] = ()
    by_law: tuple[float, float, float] | None = None

    @property
    def across(self) -> float:
        """Diameters of the scene's grains in the gap [-]."""
        return self.gap / self.diameter

    @property
    def coarse_graining(self) -> float:
        """Diameter of the scene's grains over that of the real ones [-]; 1 where the scene does not say."""
        return self.diameter / (self.real_diameter or self.diameter)

    @property
    def is_coarser(self) -> bool:
        """Whether the grains are larger than those that they stand for."""
        return self.coarse_graining > 1.0 + 1e-9

    def torque_excess(self) -> tuple[float, float, float] | None:
        """Torque of these grains over that of the real ones, less 1, with its 95 % interval; None of real ones."""
        if not self.is_coarser or self.real_diameter is None:
            return None
        if self.by_law is not None:
            return self.by_law
        coarse, real = self.across**-EXPONENT, (self.gap / self.real_diameter) ** -EXPONENT
        value, low, high = ((1.0 + a * coarse) / (1.0 + a * real) - 1.0 for a in COEFFICIENT)
        return value, low, high

    def in_words(self, measured: bool = False) -> str:
        """Return one line for people, without the warnings.

        `measured`: an accuracy study of the device knows the error of the size, and the general law is not printed.
        """
        if not self.is_coarser or self.real_diameter is None:
            return f"{self.across:.2g} grains of real size span the gap, and {self.count:.2g} fill the device"
        text = (
            f"{self.across:.2g} simulated grains span the gap; the real powder has "
            f"{self.gap / self.real_diameter:.2g} ({1e6 * self.real_diameter:.3g} µm)"
        )
        excess = self.torque_excess()
        if measured or excess is None or excess[0] > MAX_EXCESS:  # a warning has it
            return text
        return f"{text}. Coarse grains typically raise the torque by {excess_in_words(excess)}"

    def warnings(self, measured: bool = False) -> list[str]:
        """Return what makes the torque doubtful: few grains without a word on the real ones, effects with a size.

        `measured` as of `in_words`; else coarse grains, too.
        """
        found = []
        if self.real_diameter is None and self.across < FINE:
            found.append(
                f"the gap holds only {self.across:.2g} grains: right for shot of this size; where they stand for a "
                "finer powder, set particles.stands_for to its diameter"
            )
        excess = self.torque_excess()
        if not measured and excess is not None and excess[0] > MAX_EXCESS:
            found.append(
                f"grains {self.coarse_graining:.2g} times coarser than real typically raise the torque by "
                f"{excess_in_words(excess)}. Take a smaller particles.diameter, or run a grain-size study"
            )
        if self.is_coarser:
            found += [f"{note}: give values for the coarse grains, not those of the real powder" for note in self.notes]
        return found

    def as_dict(self, measured: bool = False) -> dict[str, Any]:
        """Return the entries of ``summary.json``, in SI; `measured` as of `in_words`.

        What coarse grains add to the torque is a note: the best estimate of the torque is without it.
        """
        note, excess = self.in_words(measured=True), self.torque_excess()
        if not measured and excess is not None:
            how = "typically raise" if self.by_law is None else "by the law of the powder change"
            note += f". Coarse grains {how} the torque by {excess_in_words(excess)}"
        found = {"across": self.across, "grains": self.count, "note": note}
        if self.real_diameter is not None:
            found |= {
                "coarse_graining": self.coarse_graining,
                "real_across": self.gap / self.real_diameter,
                "real_grains": self.real_count,
            }
        if excess is not None:
            found |= dict(zip(("torque_excess", "torque_excess_low", "torque_excess_high"), excess, strict=True))
        return found | ({"warnings": warnings} if (warnings := self.warnings(measured=True)) else {})


def excess_in_words(excess: tuple[float, float, float]) -> str:
    """Return a share with the ends of its interval in per cent."""
    value, low, high = (100.0 * one for one in excess)
    return f"{value:.2g} % (95 %: {low:.2g} to {high:.2g})"


def grain_size(scene: Scene, device: Device, by_law: tuple[float, float, float] | None = None) -> GrainSize | None:
    """Of a scene whose gap is sheared and whose grains attract one another; None of others, such as shot.

    `by_law` as of `GrainSize`.
    """
    if scene.effects.attraction is None or not device.shear_gap:
        return None
    particles = scene.grains
    return GrainSize(
        device.shear_gap,
        particles.mean_diameter,
        device.fill.count * particles.n_sectors,
        particles.real_diameter,
        device.fill.mass / particles.density / particles.real_grain_volume,
        tuple(f"effects.{one.name}: {one.size_note}" for one in scene.effects.present if one.size_note),
        by_law,
    )
