"""Materials of a device: magnetic law and conductivity of each region of its mesh, and the law of its grains."""

from __future__ import annotations

from collections.abc import Iterable

from emclutch.scene.model import Scene
from field import GrainLaw, Law, ThesisLaw, material
from field.laws.coercivity import coercivity, misfit_of_curve
from field.laws.conductivity import conductivity
from field.laws.major_loop import MajorLoopLaw
from field.laws.pinning import Pinning
from field.laws.temperature import ScaledLaw, saturation_ratio
from geometry import Mesh3D, SectionMesh


def grain_law(scene: Scene) -> GrainLaw:
    """Law of the grains; linear when the effect `saturation` is off."""
    particles = scene.grains
    saturation = saturation_of(scene) if scene.effects.saturate else None
    return (ThesisLaw if particles.law == "thesis" else GrainLaw)(particles.susceptibility, saturation)


def saturation_of(scene: Scene) -> float:
    """Saturation magnetisation [A/m] of the grains at their temperature."""
    return scene.grains.saturation * saturation_ratio_of(scene)


def saturation_ratio_of(scene: Scene) -> float:
    """Saturation of grains and steel at their temperature over that of their data."""
    return 1.0 if scene.field is None else saturation_ratio(scene.field.temperature)


def region_laws(scene: Scene, mesh: SectionMesh | Mesh3D) -> dict:
    """Magnetic law of each region of the mesh, by the scene's names of materials."""
    return {region: magnetic_law(scene, name) for region, name in region_materials(scene, mesh).items()}


def region_materials(scene: Scene, mesh: SectionMesh | Mesh3D) -> dict[str, str]:
    """Name of the material of each region of the mesh that has one."""
    return scene.geometry.region_materials(mesh.regions)


def conductivities(scene: Scene, mesh: SectionMesh) -> dict[str, float] | None:
    """Conductivity [S/m] of the solid regions, the winding excepted; None without eddy currents."""
    effect = scene.effects.eddy
    if effect is None:
        return None
    return {
        region: effect.conductivity.get(name, conductivity_of(scene, name))
        for region, name in region_materials(scene, mesh).items()
        if region != "coil"
    }


def conductivity_of(scene: Scene, name: str) -> float:
    """A material's conductivity [S/m]: the scene's own under this name (none: 0), or a built-in one."""
    own = scene.materials.get(name)
    return conductivity(name).sigma if own is None else own.conductivity or 0.0


def pinning_of(scene: Scene, name: str) -> Pinning:
    """A material's hysteresis: of the effect's table, of the scene's own loop or coercivity, or of the library.

    Raises
    ------
    ValueError
        A coercivity that the material's curve does not allow (`Pinning.of`).
    """
    own, given = scene.materials.get(name), scene.effects.memory.coercivity
    law, ratio = _law_as_given(scene, name), saturation_ratio_of(scene)
    if name in given:
        found = Pinning.of(law, given[name])
    elif isinstance(law, MajorLoopLaw):
        found = law.pinning
    else:
        found = Pinning.of(law, coercivity(name).H_c if own is None else own.coercivity or 0.0)
    return found if ratio == 1.0 else Pinning(found.stiffness, ratio * found.reach)  # the loop scales with its curve


def hysteresis_of(scene: Scene, names: Iterable[str]) -> tuple[str, list[str]]:
    """Coercivity and remanence of the steels among some materials in words, and warnings; empty without the effect."""
    texts, warnings = [], []
    for name in sorted(set(names)) if scene.effects.memory is not None else ():
        law, pinning = magnetic_law(scene, name), pinning_of(scene, name)
        if pinning.coercivity > 0.0:
            remanence = f"remanence {pinning.remanence(law):.2g} T from saturation"
            texts.append(f"{name}: coercivity {pinning.coercivity:.3g} A/m, {remanence}")
            misfit = "" if isinstance(_law_as_given(scene, name), MajorLoopLaw) else misfit_of_curve(law, pinning)
            warnings += [f"{name}: {misfit}"] if misfit else []
    return ", ".join(texts), warnings


def magnetic_law(scene: Scene, name: str) -> Law:
    """A material's law at the temperature of the steel: the scene's own under this name, or a built-in one."""
    return ScaledLaw.of(_law_as_given(scene, name), saturation_ratio_of(scene))


def _law_as_given(scene: Scene, name: str) -> Law:
    own = scene.materials.get(name)
    return material(name) if own is None else own.magnetic_law(name)
