"""[effects]: what generic code asks of all effects of a scene together."""

from __future__ import annotations

from typing import Any, get_args

from emclutch.effects.effect import EffectSection
from emclutch.scene.section import Section


class BaseEffectsSection(Section):
    """The effects of a scene; one without its table does not exist."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the effects that this version has."""
        return tuple(cls.model_fields)

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the effects that the scene has."""
        return tuple(name for name, one in vars(self).items() if one is not None)

    @property
    def present(self) -> tuple[EffectSection, ...]:
        """The tables that the scene has, in the order in which they act."""
        return tuple(one for one in vars(self).values() if one is not None)

    def get(self, name: str) -> Any:
        """Return the table of an effect by its name; None where the scene, or this version, has none."""
        return getattr(self, name, None)

    def _in_role(self, role: str) -> Any:
        return next((one for one in self.present if one.role == role), None)

    @property
    def weight(self) -> Any:
        """The effect with `acceleration` [m/s^2], `direction` and `vector` that acts on every grain; None without."""
        return self._in_role("weight")

    @property
    def attraction(self) -> Any:
        """The effect by which magnetised grains attract one another; None without.

        It has `model`, `cutoff` [grain diameters], `update_every`, `tolerance`, `surface_gap`, `has_necks`,
        `methods_compared`.
        """
        return self._in_role("attraction")

    @property
    def images(self) -> Any:
        """The effect by which steel walls mirror the grains' moments; None without."""
        return self._in_role("images")

    @property
    def feedback(self) -> Any:
        """The effect by which the grains change the solved field, with its `tolerance`; None without."""
        return self._in_role("feedback")

    @property
    def rolling(self) -> Any:
        """The effect by which grains resist rolling, with its `coefficient`; None without."""
        return self._in_role("rolling")

    @property
    def circuit(self) -> Any:
        """The effect by which the coil's current follows from its voltage; None without."""
        return self._in_role("circuit")

    @property
    def eddy(self) -> Any:
        """The effect by which solid conductors delay the field; None without."""
        return self._in_role("eddy")

    @property
    def memory(self) -> Any:
        """The effect by which the steel remembers earlier fields, with its `coercivity` [A/m]; None without."""
        return self._in_role("memory")

    @property
    def thermal(self) -> Any:
        """The effect by which slip and copper warm the device; None without."""
        return self._in_role("thermal")

    @property
    def magnetise(self) -> bool:
        """True if an effect acts on magnetised grains."""
        return any(one.needs_moments for one in self.present)

    @property
    def have_lagged_forces(self) -> bool:
        """True if an effect adds to the lagged forces, which are constant over several steps."""
        return any(one.has_lagged_forces for one in self.present)

    @property
    def saturate(self) -> bool:
        """True if the grains saturate."""
        return any(one.saturates for one in self.present)

    def contact_terms(self) -> dict[str, Any]:
        """Return the parts of every contact, by the keyword of `particles.PairLaws.of_one`."""
        return {name: part for one in self.present for name, part in one.contact_terms().items()}

    @classmethod
    def kinds(cls) -> tuple[type[EffectSection], ...]:
        """Return the tables that this version has."""
        return tuple(get_args(field.annotation)[0] for field in cls.model_fields.values())

    @classmethod
    def tables(cls, **of: Any) -> str:
        """Return "[effects.A] or [effects.B]": the effects whose attributes have the values given."""
        named = [one.name for one in cls.kinds() if all(getattr(one, key) == value for key, value in of.items())]
        return " or ".join(f"[effects.{name}]" for name in sorted(named))
