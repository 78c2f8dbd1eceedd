"""More current, more torque: the one thing that a powder clutch must do."""

from pathlib import Path

import numpy as np

import emclutch

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
CURRENTS = (0.0, 0.4, 1.2)


def test_torque_rises_with_current(tmp_path):
    """Quickstart on part of its sector, sheared by more than a half: steps of the torque of many times its noise.

    Noise: the error of the mean of eight batches of the later half. Without current what is left is the drag of
    friction.
    """
    toy = {
        "motion.rotor.speed": "1500 rpm", "time.end": "0.2 ms", "time.window": 5e-6,
        "particles.sector": "3.75 deg", "field.size_factor": 2.0,
        "output.snapshots": 0, "output.pictures": False, "output.formats": [], "output.checkpoint": False,
    }  # fmt: skip
    torque, noise = [], []
    for current in CURRENTS:
        case = emclutch.load_case(QUICKSTART).with_values({**toy, "coil.current": current})
        history = emclutch.run(case, out=tmp_path / f"{current} A").history
        late = history["torque_disc"].to_numpy()[history["time"] > 0.1e-3]
        batches = np.array([part.mean() for part in np.array_split(late, 8)])
        torque.append(batches.mean())
        noise.append(batches.std(ddof=1) / np.sqrt(len(batches)))
    for k in (1, 2):
        assert torque[k] - torque[k - 1] > 5.0 * np.hypot(noise[k], noise[k - 1]), (torque, noise)
    assert torque[0] < 0.1 * torque[2], (torque, noise)
