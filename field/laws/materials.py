"""Materials by name: the magnetic laws that ship, each with its source.

A name is read without regard to case, and with blank or hyphen for the underscore; other common names of the same
material (`pure_iron`, `x6cr17`, `aluminum`) lead to it.  Their electrical conductivity is in `conductivity`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import cache
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from field.laws.magnetisation_curve import PermeabilityLaw, TableLaw
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import AIR, Law, LinearLaw

Entry = TypeVar("Entry")

# FEMM's tables of 1010, 1018, 1020 and 416 go on to where J = B - mu_0 H is constant within its last digit, and a cubic
# through the last points falls up to 4 % below mu_0. The points here end where dB/dH is still 1.4 to 2.6 mu_0; beyond,
# J approaches exponentially the J_s that the tables reach (`TableLaw`): within 4 mT of every point that is left out.

# H [A/m], B [T]; left out: (79577.5, 2.095), (159155, 2.2), (318310, 2.4), (1909860, 4.4)
_STEEL_1010 = np.array(
    [
        (0.0, 0.0),
        (238.7, 0.2003),
        (318.3, 0.3204),
        (358.1, 0.40045),
        (437.7, 0.50055),
        (477.5, 0.5606),
        (636.6, 0.7908),
        (795.8, 0.9310),
        (1114.1, 1.1014),
        (1273.2, 1.2016),
        (1591.5, 1.302),
        (2228.2, 1.4028),
        (3183.1, 1.524),
        (4774.6, 1.626),
        (6366.2, 1.698),
        (7957.7, 1.73),
        (15915.5, 1.87),
        (47746.5, 2.04),
        (63662.0, 2.07),
    ]
)

# H [A/m], B [T]; left out: (79577.5, 2.11), (159155, 2.225), (318310, 2.43)
_STEEL_1018 = np.array(
    [
        (0.0, 0.0),
        (238.7325, 0.2503),
        (795.775, 0.925),
        (1591.55, 1.25),
        (2387.325, 1.39),
        (3978.875, 1.525),
        (7957.75, 1.71),
        (15915.5, 1.87),
        (23873.25, 1.955),
        (39788.75, 2.02),
    ]
)

# H [A/m], B [T]; every second point; left out: (79577.5, 2.280053), (126121.8, 2.339975), (199889.6, 2.432708),
# (316803.6, 2.579627)
_STEEL_1020 = np.array(
    [
        (0.0, 0.0),
        (79.577472, 0.166252),
        (126.121793, 0.261635),
        (199.889571, 0.407495),
        (316.80362, 0.619366),
        (502.099901, 0.893195),
        (795.774715, 1.173276),
        (1261.217929, 1.373533),
        (1998.89571, 1.489189),
        (3168.036204, 1.591321),
        (5020.999013, 1.711927),
        (7957.747155, 1.834976),
        (12612.179293, 1.945262),
        (19988.957103, 2.052852),
        (31680.362037, 2.155149),
        (50209.990127, 2.229008),
    ]
)

# H [A/m], B [T]; left out: (55704, 1.74), whose J is J_s: it would bend the curve below mu_0
_STAINLESS_416 = np.array(
    [
        (0.0, 0.0),
        (318.31, 0.2004),
        (477.465, 0.4256),
        (795.775, 0.761),
        (1591.55, 1.097),
        (2387.325, 1.233),
        (3978.875, 1.335),
        (7957.75, 1.46),
        (15915.5, 1.59),
        (31831.0, 1.69),
        (44456.28, 1.724232),
    ]
)

# B [T], H [A/m]. No J_s: problems 13 and 20 are defined by these points, and M is constant beyond them, so that dB/dH
# falls at once from 1.614 mu_0 to mu_0 at 2.3 T.
_TEAM_STEEL = np.array(
    [
        (0.0, 0.0),
        (0.01, 27.0),
        (0.025, 58.0),
        (0.05, 100.0),
        (0.1, 153.0),
        (0.15, 185.0),
        (0.2, 205.0),
        (0.3, 233.0),
        (0.4, 255.0),
        (0.5, 285.0),
        (0.6, 320.0),
        (0.7, 355.0),
        (0.8, 405.0),
        (0.9, 470.0),
        (1.0, 555.0),
        (1.1, 673.0),
        (1.2, 836.0),
        (1.3, 1065.0),
        (1.35, 1220.0),
        (1.4, 1420.0),
        (1.45, 1720.0),
        (1.5, 2130.0),
        (1.55, 2670.0),
        (1.6, 3480.0),
        (1.65, 4500.0),
        (1.7, 5950.0),
        (1.75, 7650.0),
        (1.8, 10100.0),
        (1.85, 13000.0),
        (1.9, 15900.0),
        (1.95, 21100.0),
        (2.0, 26300.0),
        (2.05, 32900.0),
        (2.1, 42700.0),
        (2.15, 61700.0),
        (2.2, 84300.0),
        (2.25, 110000.0),
        (2.3, 135000.0),
    ]
)

_FEMM = "the table of FEMM's matlib.dat"
_BEYOND = "from H = {} kA/m on J approaches J_s exponentially (Umenei, Melikhov and Jiles 2011)"
_FLUX_TUBES = "Modelica Standard Library, Magnetic.FluxTubes.Material.SoftMagnetic"

_MATERIALS: dict[str, Callable[[], Law]] = {
    "air": lambda: AIR,
    "aluminium": lambda: LinearLaw(1.0, "aluminium", "mu_r - 1 = 2e-5, taken as 1"),
    "copper": lambda: LinearLaw(1.0, "copper", "mu_r - 1 = -1e-5, taken as 1"),
    "stainless_304": lambda: LinearLaw(1.0, "stainless_304", "austenitic, annealed: mu_r = 1"),
    "steel_1010": lambda: TableLaw(
        _STEEL_1010[:, 0],
        _STEEL_1010[:, 1],
        "steel_1010",
        f"AISI 1010 low-carbon steel, {_FEMM}; {_BEYOND.format(63.7)}",
        J_s=2.0,
    ),
    "steel_1018": lambda: TableLaw(
        _STEEL_1018[:, 0],
        _STEEL_1018[:, 1],
        "steel_1018",
        f"AISI 1018 low-carbon bar, {_FEMM}; {_BEYOND.format(39.8)}",
        J_s=2.03,
    ),
    "steel_1020": lambda: TableLaw(
        _STEEL_1020[:, 0],
        _STEEL_1020[:, 1],
        "steel_1020",
        f"AISI 1020 low-carbon steel, every second point of {_FEMM}; {_BEYOND.format(50.2)}; its J_s is "
        "1 % too high (iron: 2.16 T)",
        J_s=2.1815,
    ),
    "stainless_416": lambda: TableLaw(
        _STAINLESS_416[:, 0],
        _STAINLESS_416[:, 1],
        "stainless_416",
        f"AISI 416 (1.4005, free-cutting, 13 % chromium), {_FEMM}; {_BEYOND.format(44.5)}",
        J_s=1.67,
    ),
    "steel_1008": lambda: PermeabilityLaw(
        200.0, 1.17, 8100.0, 2.59, 10.0, "steel_1008", f"AISI 1008, {_FLUX_TUBES}; J_s is too high (iron: 2.16 T)"
    ),
    "stainless_430": lambda: PermeabilityLaw(
        274.0,
        1.1,
        970.0,
        1.2,
        8.3,
        "stainless_430",
        f"X6Cr17 (ferritic, AISI 430), {_FLUX_TUBES}; beyond 2 T extrapolated, J_s is too high",
    ),
    "steel_11smn30": lambda: PermeabilityLaw(
        500.0,
        1.036,
        43414.0,
        35.8,
        14.0,
        "steel_11smn30",
        f"9SMn28K, today 11SMn30 (1.0715), {_FLUX_TUBES}",
    ),
    "steel_11smnpb30": lambda: PermeabilityLaw(
        400.0,
        1.488,
        1200.0,
        3.0,
        12.5,
        "steel_11smnpb30",
        f"9SMnPb28, today 11SMnPb30 (1.0718), free-cutting, {_FLUX_TUBES}",
    ),
    "dc01": lambda: PermeabilityLaw(
        5.0,
        1.1,
        6450.0,
        3.65,
        7.7,
        "dc01",
        f"DC01 sheet, {_FLUX_TUBES}; beyond 2.1 T extrapolated, J_s is too high (iron: 2.16 T)",
    ),
    "vacofer_s2": lambda: PermeabilityLaw(
        2666.0,
        1.15,
        187000.0,
        4.24,
        19.0,
        "vacofer_s2",
        f"Vacofer S2 pure iron, {_FLUX_TUBES}; the fit ends at 1.93 T, J_s is too low (iron: 2.16 T)",
    ),
    "team_steel": lambda: TableLaw(_TEAM_STEEL[:, 1], _TEAM_STEEL[:, 0], "team_steel", "TEAM workshop problem 20"),
}

_ALIASES = {
    "aluminum": "aluminium",
    "pure_iron": "vacofer_s2",
    "x6cr17": "stainless_430",
    "aisi_430": "stainless_430",
    "aisi_304": "stainless_304",
    "aisi_416": "stainless_416",
    "aisi_1008": "steel_1008",
    "aisi_1010": "steel_1010",
    "aisi_1018": "steel_1018",
    "aisi_1020": "steel_1020",
    "9smn28k": "steel_11smn30",
    "11smn30": "steel_11smn30",
    "9smnpb28": "steel_11smnpb30",
    "11smnpb30": "steel_11smnpb30",
    "vacuum": "air",
}


class GrainMaterial(NamedTuple):
    """Material of the grains of a powder.

    Attributes
    ----------
    law : GrainLaw
    density : float
        [kg/m^3]
    source : str
    """

    law: GrainLaw
    density: float
    source: str


# Of the grain's bulk material.  Demagnetisation leaves chi/(1 + chi/3) of it, so that a grain hardly feels whether
# chi is 200 or 2000, but feels Ms in full.
_GRAINS: dict[str, GrainMaterial] = {
    "stainless_430": GrainMaterial(
        GrainLaw(273.0, 1.3e6),
        7700.0,
        "grains of ferritic stainless 430, the usual clutch powder: mu_i = 274 of X6Cr17 (FluxTubes); Ms is an order "
        "of magnitude, J_s = 1.6 T as of iron with 17 % chromium; density: EN 10088-1",
    ),
    "carbonyl_iron": GrainMaterial(
        GrainLaw(999.0, 1.707e6),
        7870.0,
        "grains of pure (carbonyl) iron: Ms = 1.707e6 A/m at 20 degrees C (Bozorth, Ferromagnetism); mu_i = 1000 is "
        "an order of magnitude; density: of pure iron (Incropera et al., table A.1)",
    ),
}


def material_names() -> list[str]:
    """Names that `material` knows, sorted; without the other names of the same materials."""
    return sorted(_MATERIALS)


def material_aliases() -> Mapping[str, str]:
    """Other names of materials, and whose they are."""
    return MappingProxyType(_ALIASES)


def grain_names() -> list[str]:
    """Names that `grain_material` knows, sorted."""
    return sorted(_GRAINS)


def canonical_name(name: str) -> str | None:
    """The name under which a built-in material is kept; None where there is none."""
    plain = _plain(name)
    return plain if plain in _MATERIALS else None


def _plain(name: str) -> str:
    plain = name.strip().lower().replace("-", "_").replace(" ", "_")
    return _ALIASES.get(plain, plain)


def material(name: str) -> Law:
    """The magnetic law of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message has the nearest one and lists all.
    """
    return _built(_known_name(name))


def entry_of(entries: Mapping[str, Entry], name: str) -> Entry:
    """What a table by canonical names has of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message of `material`.
    """
    return entries[_known_name(name)]


def _known_name(name: str) -> str:
    canonical = canonical_name(name)
    if canonical is None:
        raise ValueError(
            f"material {name!r} is not known; {_nearest(name, [*_MATERIALS, *_ALIASES])}"
            f"choose one of {', '.join(material_names())}, or give a table of H [A/m] and B [T]"
        )
    return canonical


def grain_material(name: str) -> GrainMaterial:
    """Return the material of the grains of a named powder.

    Raises
    ------
    ValueError
        Unknown name; the message lists the known ones.
    """
    plain = _plain(name)
    if plain not in _GRAINS:
        raise ValueError(
            f"powder {name!r} is not known; {_nearest(name, list(_GRAINS))}choose one of {', '.join(grain_names())}, "
            "or give susceptibility and saturation of the grain's material"
        )
    return _GRAINS[plain]


@cache
def _built(name: str) -> Law:
    return _MATERIALS[name]()


def _nearest(name: str, names: list[str]) -> str:
    # 0.65: a letter lost or two swapped, but not a name that only shares letters
    close = get_close_matches(name.lower(), names, n=1, cutoff=0.65)
    return f"did you mean {close[0]!r}? " if close else ""
