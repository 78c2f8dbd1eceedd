"""Where the accuracy studies of devices are kept, and how a device is found again."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Container, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError

log = logging.getLogger(__name__)
FOLDER = Path("runs") / "accuracy_studies"
VARIABLE = "EMCLUTCH_ACCURACY_STUDIES"
"""Environment variable of another folder."""
SHIPPED = Path(__file__).with_name("shipped_accuracy_studies")
"""Studies of shipped scenes, which come with the program."""
DRIVE = ("coil.current", "coil.voltage")
"""Keys that the error hardly depends on: written beside the study."""
WITHOUT = ("scene.", "time.", "accuracy.", "output.", "motion.drag_torque", "particles.powder_law", *DRIVE)
NAMED = frozenset(
    """geometry.air_factor geometry.materials.housing geometry.materials.rotor geometry.materials.disc
    geometry.materials.ring geometry.materials.cover geometry.materials.seal geometry.materials.shaft
    geometry.materials.coil surfaces coil.temperature field.gap_layers field.open_boundary field.newton_tolerance
    particles.density particles.packing particles.lattice particles.noise particles.settle particles.settle_kinetic
    particles.initial_velocity particles.susceptibility particles.saturation particles.law contact.method contact.law
    contact.dvi.friction_law contact.dvi.solver contact.dvi.springs contact.dvi.max_sweeps contact.dvi.allowed_misses
    contact.dvi.allow_long_step contact.dvi.theta contact.friction contact.restitution effects.dipoles.model
    effects.dipoles.surface_gap effects.rolling_friction.coefficient""".split()
)
"""Keys that count at their default too. Any other key counts where it differs from its default: a new key of the
program leaves the studies of earlier devices valid."""


def accuracy_study_folder() -> Path:
    """Return the folder of the studies: runs/accuracy_studies, or what EMCLUTCH_ACCURACY_STUDIES says."""
    return Path(os.environ.get(VARIABLE) or FOLDER)


def device_hash(flat_scene: Mapping[str, Any], excluded: Container[str], at_default: Container[str]) -> str:
    """Return the hash of what matters of a scene: all but numerical settings, seed, drive, end and output.

    Parameters
    ----------
    flat_scene : of the resolved scene, by dotted key
    excluded : keys that numerical settings change
    at_default : the keys whose entry is their default; of these only `NAMED` count
    """
    kept = {
        key: value
        for key, value in flat_scene.items()
        if key not in excluded
        and not any(key == one or (one[-1] == "." and key.startswith(one)) for one in WITHOUT)
        and (key in NAMED or key not in at_default)
    }
    return hashlib.sha256(json.dumps(kept, sort_keys=True, default=str).encode()).hexdigest()[:16]


def save_accuracy_study(study: AccuracyStudy) -> Path:
    """Write a study where runs of its device find it, in place of an earlier one; return the file."""
    target = accuracy_study_folder() / f"{study.device}.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    replace_text(target, study.to_json())
    return target


def find_accuracy_study(device: str) -> tuple[AccuracyStudy, Path] | None:
    """Return the study of a device and its file, the user's own before a shipped one; None where there is none.

    OutputError for a damaged file, or one of another version, where none is shipped.
    """
    paths = [one for folder in (accuracy_study_folder(), SHIPPED) if (one := folder / f"{device}.json").is_file()]
    for path in paths:
        try:
            return AccuracyStudy.from_json(path.read_text(encoding="utf-8")), path
        except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
            why = f"{path} is no study of this version ({error}); measure again with emclutch accuracy, or remove it"
            if path == paths[-1]:
                raise OutputError(why) from None
            _warn_once(f"{why}: the one that comes with emclutch is used")
    return None


def known_studies() -> list[AccuracyStudy]:
    """Return every readable study, the user's own first; of a device with both, the user's own."""
    files = [path for folder in (accuracy_study_folder(), SHIPPED) for path in sorted(folder.glob("*.json"))]
    found = {}
    for device in dict.fromkeys(path.stem for path in files):
        with suppress(OutputError):
            if known := find_accuracy_study(device):
                found[device] = known[0]
    return [*found.values()]


@cache
def _warn_once(message: str) -> None:
    log.warning("%s", message)
