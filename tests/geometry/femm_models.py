"""Models of FEMM in its file format, written from their dimensions: two that others published, and a small one."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from validation_devices import columns

from field.laws.magnetisation_table import read_table

CASES = Path(__file__).resolve().parents[2] / "cases" / "validation"
ENTRIES = {
    "Block": {"Mu_x": 1, "Mu_y": 1, "H_c": 0, "H_cAngle": 0, "J_re": 0, "J_im": 0, "Sigma": 0, "d_lam": 0, "Phi_h": 0,
              "Phi_hx": 0, "Phi_hy": 0, "LamType": 0, "LamFill": 1, "NStrands": 0, "WireD": 0, "BHPoints": 0},
    "Bdry": {"BdryType": 0, "A_0": 0, "A_1": 0, "A_2": 0, "Phi": 0, "c0": 0, "c0i": 0, "c1": 0, "c1i": 0, "Mu_ssd": 0,
             "Sigma_ssd": 0, "innerangle": 0, "outerangle": 0},
    "Circuit": {"TotalAmps_re": 0, "TotalAmps_im": 0, "CircuitType": 1},
}  # fmt: skip

Place = tuple[float, float]


class FemmText:
    """A model as FEMM writes it; lengths in its own unit, materials, circuits and boundaries by name."""

    def __init__(self, unit: str = "millimeters", **head: Any) -> None:
        self.head = {"Format": "4.0", "Frequency": 0, "Precision": 1e-8, "MinAngle": 30, "DoSmartMesh": 1, "Depth": 1,
                     "LengthUnits": unit, "ProblemType": "axisymmetric", "Coordinates": "cartesian", "ACSolver": 0,
                     "PrevType": 0, "PrevSoln": '""', "Comment": '"A model"'} | head  # fmt: skip
        self.points: list[tuple[float, float]] = []
        self.segments: list[str] = []
        self.arcs: list[str] = []
        self.labels: list[str] = []
        self.properties: dict[str, dict[str, str]] = {kind: {} for kind in ENTRIES}

    def add(self, kind: str, name: str, curve: list[tuple[float, float]] | None = None, **entries: Any) -> None:
        """Define a property of a kind of `ENTRIES`; `curve`: points (B, H)."""
        values = ENTRIES[kind] | entries | ({"BHPoints": len(curve)} if curve else {})
        rows = [f"    <{key}> = {value}" for key, value in values.items()]
        rows += [f"      {B!r}\t{H!r}" for B, H in curve or []]
        head = [f"  <Begin{kind}>", f'    <{kind}Name> = "{name}"']
        self.properties[kind][name] = "\n".join([*head, *rows, f"  <End{kind}>"])

    def number(self, kind: str, name: str) -> int:
        return 1 + list(self.properties[kind]).index(name) if name else 0

    def point(self, r: float, z: float) -> int:
        if (r, z) not in self.points:
            self.points.append((r, z))
        return self.points.index((r, z))

    def line(self, *corners: Place, boundary: str = "") -> None:
        """Draw segments from corner to corner."""
        for start, end in pairwise(corners):
            ends = f"{self.point(*start)}\t{self.point(*end)}"
            self.segments.append(f"{ends}\t-1\t{self.number('Bdry', boundary)}\t0\t0")

    def rectangle(self, r0: float, z0: float, r1: float, z1: float) -> None:
        self.line((r0, z0), (r1, z0), (r1, z1), (r0, z1), (r0, z0))

    def arc(self, start: Place, end: Place, degrees: float = 180.0, boundary: str = "") -> None:
        ends = f"{self.point(*start)}\t{self.point(*end)}"
        self.arcs.append(f"{ends}\t{degrees}\t1\t{self.number('Bdry', boundary)}\t0\t0")

    def label(self, r: float, z: float, material: str, circuit: str = "", turns: int = 1, **more: int) -> None:
        """Place a label; `more`: group, extern."""
        kinds = f"{self.number('Block', material)}\t-1\t{self.number('Circuit', circuit)}\t0"
        self.labels.append(f"{r}\t{z}\t{kinds}\t{more.get('group', 0)}\t{turns}\t{more.get('extern', 0)}")

    def __str__(self) -> str:
        rows = [f"[{key}] = {value}" for key, value in self.head.items()] + ["[PointProps] = 0"]
        for kind in ("Bdry", "Block", "Circuit"):
            rows += [f"[{kind}Props] = {len(self.properties[kind])}", *self.properties[kind].values()]
        points = [f"{r!r}\t{z!r}\t0\t0" for r, z in self.points]
        lists = {"Points": points, "Segments": self.segments, "ArcSegments": self.arcs, "Holes": []}
        for name, entries in {**lists, "BlockLabels": self.labels}.items():
            rows += [f"[Num{name}] = {len(entries)}", *entries]
        return "\n".join(rows) + "\n"

    def write(self, path: Path) -> Path:
        path.write_text(str(self), encoding="utf-8")
        return path


def small_model(unit: str = "millimeters", scale: float = 1.0, **head: Any) -> FemmText:
    """A winding of 100 turns and 2 A around an iron ball in a half disc of air that ends at A = 0."""
    model = FemmText(unit, **head)
    model.add("Bdry", "A=0")
    model.add("Block", "Air")
    model.add("Block", "Copper", Sigma=58)
    model.add("Block", "Soft iron, pure", Mu_x=1000, Mu_y=1000, Sigma=10)
    model.add("Circuit", "coil", TotalAmps_re=2)
    r = [scale * x for x in (0.0, 5.0, 8.0, 12.0, 60.0)]
    model.rectangle(r[2], -r[1], r[3], r[1])
    model.line((0.0, -r[4]), (0.0, -r[1]), (0.0, r[1]), (0.0, r[4]))
    model.arc((0.0, -r[1]), (0.0, r[1]))
    model.arc((0.0, -r[4]), (0.0, r[4]), boundary="A=0")
    model.label(0.5 * (r[2] + r[3]), 0.0, "Copper", "coil", 100)
    model.label(0.5 * r[1], 0.0, "Soft iron, pure", group=1)
    model.label(0.5 * r[4], 0.0, "Air")
    return model


def roters_plunger(s: float) -> FemmText:
    """FEMM's example roters1b [in], its plunger (group 1) displaced by s; shape: cases/validation/roters.geo."""
    model = FemmText("inches")
    model.add("Bdry", "A=0")
    model.add("Block", "Air")
    model.add("Block", "Coil")
    H, B = read_table(CASES / "roters_steel.csv")
    model.add("Block", "Roters 1020 1/2 Hard", list(zip(B.tolist(), H.tolist(), strict=True)), Mu_x=600, Mu_y=600)
    model.add("Circuit", "Coil Current", TotalAmps_re=1.5)
    shell = [(0.6875, 0.0), (0.8125, 0.0), (1.0391626, 1.612788), (1.75, 1.6875), (1.75, 5.8125),
             (0.9321766, 5.8984567), (0.8125, 6.75), (0.6875, 6.75), (0.6875, 5.5), (1.5625, 5.5), (1.5625, 2.0),
             (0.6875, 2.0)]  # fmt: skip
    model.line(*shell, shell[0])
    model.line((0.6875, 2.0), (0.6875, 5.5))
    model.line((0.0, -0.5 - s), (0.65625, -0.5 - s), (0.65625, 5.4375 - s), (0.46875, 6.75 - s), (0.0, 6.75 - s))
    model.line((0.0, 8.0), (2.5, 8.0), (2.5, -2.5), (0.0, -2.5), boundary="A=0")
    model.line((0.0, -2.5), (0.0, -0.5 - s), (0.0, 6.75 - s), (0.0, 8.0))
    model.label(1.125, 3.75, "Coil", "Coil Current", 2550)
    model.label(1.625, 2.75, "Roters 1020 1/2 Hard")
    model.label(0.25, 4.75 - s, "Roters 1020 1/2 Hard", group=1)
    model.label(1.375, 6.875, "Air")
    return model


def marble_accelerator(z: float, coils: dict[str, tuple[float, float, float, float]], turns: int) -> FemmText:
    """F. Mink's MarbleAccelerator [mm]: a steel ball of 12.7 mm at z, 20 A in the first coil (r0, z0, r1, z1)."""
    model = FemmText("millimeters")
    model.add("Bdry", "a0")
    model.add("Block", "Air")
    model.add("Block", "Copper", Sigma=58)
    model.add("Block", "Steel", Mu_x=1000, Mu_y=1000)  # a ball's moment is within 0.3 % of that of any mu_r above
    for k, (name, box) in enumerate(coils.items()):
        model.add("Circuit", name, TotalAmps_re=0.0 if k else 20.0)
        model.rectangle(*box)
        model.label(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), "Copper", name, turns)
    model.line((0.0, -150.0), (0.0, z - 6.35), (0.0, z + 6.35), (0.0, 150.0))
    model.arc((0.0, -150.0), (0.0, 150.0), boundary="a0")
    model.arc((0.0, z - 6.35), (0.0, z + 6.35))
    model.label(1.0, z, "Steel", group=1)
    model.label(40.0, 0.0, "Air")
    return model


def femm_forces() -> dict[float, float]:
    """FEMM's pull on the plunger of `roters_plunger` [N] by its displacement [in]."""
    data = columns("roters.csv")
    return dict(zip(data["s [in]"].tolist(), data["FEMM [N]"].tolist(), strict=True))


def air_coil(r0: float, r1: float, length: float, turns: int, current: float = 1.0) -> FemmText:
    """An air coil [in] in a ball of air of twice its size, with the asymptotic condition of FEMM's examples."""
    model = FemmText("inches")
    radius = 2.0 * max(r1, length)
    model.add("Bdry", "abc", BdryType=2, c0=1.0 / (0.0254 * radius * 4e-7 * math.pi))
    model.add("Block", "coil")
    model.add("Block", "air")
    model.add("Circuit", "icoil", TotalAmps_re=current)
    model.rectangle(r0, -0.5 * length, r1, 0.5 * length)
    model.line((0.0, -radius), (0.0, radius))
    model.arc((0.0, -radius), (0.0, radius), boundary="abc")
    model.label(0.5 * (r0 + r1), 0.0, "coil", "icoil", turns)
    model.label(0.75 * radius, 0.0, "air")
    return model


def powder_clutch() -> FemmText:
    """Powder [mm] between two steel rings (groups 1 and 2) with a housing (group 0) that holds the winding."""
    model = FemmText("millimeters")
    model.add("Bdry", "A=0")
    for name, mu, sigma in (("Air", 1, 0), ("Copper", 1, 58), ("Powder", 5, 0), ("Steel", 1000, 5), ("Brass", 1, 16)):
        model.add("Block", name, Mu_x=mu, Mu_y=mu, Sigma=sigma)
    model.add("Circuit", "coil", TotalAmps_re=1)
    for box, label, options in (
        ((15.0, -10.0, 24.0, 10.0), "Steel", {"group": 1}),
        ((24.0, -8.0, 26.0, 8.0), "Powder", {}),
        ((24.0, -10.0, 26.0, -8.0), "Brass", {"group": 2}),
        ((24.0, 8.0, 26.0, 10.0), "Brass", {"group": 2}),
        ((26.0, -10.0, 30.0, 10.0), "Steel", {"group": 2}),
        ((31.0, -6.0, 36.0, 6.0), "Copper", {"circuit": "coil", "turns": 300}),
        ((36.0, -10.0, 42.0, 10.0), "Steel", {}),
    ):
        model.rectangle(*box)
        model.label(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), label, **options)
    model.line((0.0, -120.0), (0.0, 120.0))
    model.arc((0.0, -120.0), (0.0, 120.0), boundary="A=0")
    model.label(60.0, 0.0, "Air")
    return model
