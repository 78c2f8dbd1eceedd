"""A law for every region of a mesh: those that are given, and air where no iron can be."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from field.laws.reluctivity import AIR, Law


def complete_laws(regions: Collection[str], laws: Mapping[str, Law], without_iron: Collection[str]) -> dict[str, Law]:
    """The laws by region.

    Parameters
    ----------
    regions : collection of str
        Of the mesh.
    laws : dict of str to Law
    without_iron : collection of str
        Regions that are air where no law is given for them.

    Raises
    ------
    ValueError
        A region without a law, a law without a region.
    """
    complete: dict[str, Law] = {name: AIR for name in without_iron if name in regions}
    complete.update(laws)
    missing = sorted(set(regions) - set(complete))
    unknown = sorted(set(complete) - set(regions))
    if missing:
        raise ValueError(
            f"no magnetic law for region(s) {', '.join(missing)} of the mesh; "
            "give each a material, `air` for non-magnetic ones"
        )
    if unknown:
        raise ValueError(
            f"a magnetic law for {', '.join(unknown)}, but the mesh has no such region; "
            f"it has {', '.join(sorted(regions))}"
        )
    return complete
