"""Random scenes broken on purpose: wrong types, units, signs, NaN, unknown keys, sections that contradict each other.

Two kinds of faults are distinguished. Some are wrong for certain (a NaN, a truth value for a number, a key that no
section has): the scene must be refused, by the name of that key. Others may leave a right scene (another length, a key
less): nothing is asked of them but what is asked of every scene.
"""

from __future__ import annotations

import copy
import datetime
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from random_scenes import MAGNETIC, OF_A_COIL, PLAIN, RandomScene, scenes, studies
from random_values import Table

_BLOCK = 9
Path = tuple[str | int, ...]

NEVER_RIGHT = (math.nan, math.inf, -math.inf, datetime.date(2024, 5, 17), [[]], {"zzz": 1})
ODD = (
    "", " ", "auto", "none", 0, 1, 2, -1, -0.0, 5e-324, 1e-300, 1e-9, 1e-3, 0.5, 1e3, 1e300, 10**30, True, False,
    [], [1], {}, "1e400 m", "3 kg", "-1 mm", "1 um", "10 m", "1,5 mm", "50 Hz", "1e-30 s", "9**9**9 m", "1 mm mm",
    "rim", "disc", "../../elsewhere.csv", "/dev/zero", ".", "\x00", "no such file.csv", "x" * 5000, "x\x1b[2Jy",
    "linear", "sphere",
)  # fmt: skip
SWAPPED = ("geometry", "particles", "contact", "effects", "motion", "field", "coil", "time", "output")


def paths_of(entry: Any, at: Path = ()) -> Iterator[Path]:
    """Where every entry of a scene stands, tables and lists among them."""
    steps = entry.items() if isinstance(entry, dict) else enumerate(entry) if isinstance(entry, list) else ()
    for step, below in steps:
        yield (*at, step)
        yield from paths_of(below, (*at, step))


def dotted(path: Path) -> str:
    """As a fault writes it."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).lstrip(".")


def entry_at(data: Any, path: Path) -> Any:
    for step in path:
        data = data[step]
    return data


@st.composite
def certain_faults(draw: st.DrawFn) -> RandomScene:
    """A scene with one fault that must be reported by its key."""
    scene = draw(scenes())
    data = copy.deepcopy(scene.data)
    paths = list(paths_of(data))
    if draw(st.sampled_from((True, False, False, False))):
        tables = [(), *(path for path in paths if isinstance(entry_at(data, path), dict))]
        path = (*draw(st.sampled_from(tables)), "zzz_nonsense")
        value: Any = draw(st.sampled_from((1, "text", {})))
    else:
        # a value: of a table, an empty one of the wrong keys may be right
        path = draw(st.sampled_from([p for p in paths if not isinstance(entry_at(data, p), (dict, list))]))
        value = draw(st.sampled_from(NEVER_RIGHT))
    entry_at(data, path[:-1])[path[-1]] = value
    return replace(scene, data=data, named=(dotted(path),), breaks=(f"{dotted(path)} = {value!r}"[:80],))


@st.composite
def changes(draw: st.DrawFn, scene: RandomScene) -> RandomScene:
    """One change that may break a scene."""
    data = copy.deepcopy(scene.data)
    paths = list(paths_of(data))
    kind = draw(
        st.sampled_from(("odd", "odd", "odd", "removed", "swapped", "effect", "copied", "amounts", "lost file"))
    )
    if kind == "lost file":
        name = draw(st.sampled_from(sorted(scene.files)))
        files = {key: text for key, text in scene.files.items() if key != name}
        files |= draw(
            st.sampled_from(({}, {name: ""}, {name: "\x00\x01"}, {name: "a, b\n1, 2\n"}, {name: "H [A/m]\nx"}))
        )
        return replace(scene, files=files, breaks=(*scene.breaks, f"{name} lost"))
    if kind == "swapped":
        other = draw(scenes()).data
        name = draw(st.sampled_from(SWAPPED))
        data |= {name: other[name]} if name in other else {}
        done = f"[{name}] of another scene"
    elif kind == "effect":
        tables = PLAIN | MAGNETIC | OF_A_COIL
        name = draw(st.sampled_from(sorted(tables)))
        if isinstance(data.get("effects"), dict):
            data["effects"][name] = draw(tables[name])
        done = f"effects.{name} added"
    elif kind == "amounts":
        if isinstance(data.get("particles"), dict):
            data["particles"] |= draw(st.sampled_from(({"count": 3}, {"mass": "1 kg"}, {"solid_fraction": 0.7})))
        done = "another amount"
    elif not paths:
        return scene
    else:
        path = draw(st.sampled_from(paths))
        table, done = entry_at(data, path[:-1]), f"{dotted(path)} {kind}"
        if kind == "removed":
            del table[path[-1]]
        else:
            source = draw(st.sampled_from(paths)) if kind == "copied" else None
            value = draw(st.sampled_from(ODD)) if source is None else copy.deepcopy(entry_at(data, source))
            table[path[-1]] = value
            done = f"{dotted(path)} = {value!r}"[:80]
    return replace(scene, data=data, breaks=(*scene.breaks, done))


@st.composite
def changed(draw: st.DrawFn) -> RandomScene:
    """A scene with one to three changes."""
    scene = draw(scenes())
    for _ in range(draw(st.integers(1, 3))):
        scene = draw(changes(scene))
    return scene


@st.composite
def changed_studies(draw: st.DrawFn) -> RandomScene:
    """A study of which an entry is odd."""
    scene = draw(studies())
    study: Table = copy.deepcopy(scene.study or {})
    path = draw(st.sampled_from(list(paths_of(study))))
    value = draw(st.sampled_from((*ODD, ["a"], {"coil.current": [1]}, [[1], [2]])))
    entry_at(study, path[:-1])[path[-1]] = value
    return replace(scene, study=study, breaks=(f"{dotted(path)} = {value!r}"[:80],))


@st.composite
def cut_texts(draw: st.DrawFn) -> RandomScene:
    """A scene's file that ends too early, or has a byte that is no text."""
    return replace(draw(scenes()), cut=draw(st.floats(0.0, 1.0)), breaks=("text cut",))


def drawn(count: int, first: int) -> Iterator[RandomScene]:
    """So many scenes of a seed: half of them as an author might mean them, half of them broken."""
    for block in range(-(-count // _BLOCK)):
        yield from _block(hash((first, block)))[: count - block * _BLOCK]


def _block(number: int) -> list[RandomScene]:
    """Nine scenes. hypothesis begins with the simplest there is, and from the eleventh on repeats parts of others."""
    kinds = [scenes()] * 9 + [studies(), changed_studies(), cut_texts()] + [certain_faults()] * 3 + [changed()] * 5
    found: list[RandomScene] = []

    @seed(number)
    @settings(
        max_examples=_BLOCK + 1,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(scene=st.integers(0, len(kinds) - 1).flatmap(lambda kind: kinds[kind]))
    def take(scene: RandomScene) -> None:
        found.append(scene)

    take()
    return found[1:]
