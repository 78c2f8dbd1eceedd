"""Sobol' indices of a study's torque: the share of its variance that each value has, alone and in all.

Of a study that was sampled by ``method = "saltelli"``: matrices A and B of N points, and for every value i the matrix
A_B^i, A with the column i of B (Saltelli et al., Computer Physics Communications 181, 2010). With f the torque,

    S1_i = mean(f_B (f_AB^i - f_A)) / V,    ST_i = mean((f_A - f_AB^i)^2) / (2 V),    V = var(f_A, f_B),

by SALib (extra ``sensitivity``), which also resamples the N points for the 95 % bars. The torque of a run has
noise by its seed, which adds to the scatter: V grows by the noise's mean variance, and so does every numerator of ST; a
value without effect would have ST = noise/V. What is known of each point's noise is therefore subtracted:
mean(s_A^2, s_B^2) from V, half of mean(s_A^2 + s_AB^2) from the numerator of ST. The bars have the noise in them, since
each of the resampled points has its own. Runs with the same seed begin with the same packing at every point; what they
have in common cancels in V and in both numerators, hence it is no part of s: of p replicas of n points, s^2 is
sum (f_jk - mean_k f_jk - mean_j f_jk + mean f)^2 / ((n - 1) (p - 1)) / p.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results import study_folder
from emclutch.results.errors import OutputError
from emclutch.scene.study import StudySection, read_study

if TYPE_CHECKING:
    import pandas

SEED = "scene.seed"
RESAMPLES = 1000


def sobol_indices(study: StudySection | str | Path, folder: str | Path) -> pandas.DataFrame:
    """Sobol' indices of the torque of a study whose points are all done.

    Parameters
    ----------
    study : that was sampled by ``saltelli``, or the path of its file. Values of `scene.seed` are replicas of each
        point: from two on the noise of their mean is their scatter, less what runs of one seed have in common, pooled
        over all points; of one it is the run's own standard error.
    folder : of its results.

    Returns
    -------
    DataFrame
        A row for each sampled value: `value`, `first` and `first_bar`, `total` and `total_bar` (half of 95 %
        intervals), `noise`: the share of the replicas' noise in the variance of the torques before it was subtracted.

    Raises
    ------
    OutputError
        SALib is not installed, the study has another sample, points are not done, a noise is not known, or it is all
        that the torques' variance has.
    """
    import pandas

    study = study if isinstance(study, StudySection) else read_study(study)
    if study.sample is None or study.sample.method != "saltelli":
        raise OutputError(
            f"{study.path} has no sample for Sobol' indices; sample its ranges with [study.sample] method = 'saltelli'"
        )
    torque, noise = _points(study, study_folder.read_study(Path(folder)).table)
    return pandas.DataFrame(indices_of(list(study.sample.over), torque, noise))


def indices_of(names: list[str], torque: np.ndarray, noise: np.ndarray) -> list[dict[str, Any]]:
    """Sobol' indices of noisy outputs; rows as of `sobol_indices`.

    Parameters
    ----------
    names : of the d values.
    torque : (N (d + 2),) outputs, of each point of A, of A_B^1, ..., A_B^d and of B, in the order of SALib.
    noise : (N (d + 2),) their standard errors.

    Raises
    ------
    OutputError
        SALib is not installed, or the noise is all that the variance has.
    """
    try:
        from SALib.analyze import sobol
    except ImportError as error:
        raise OutputError(
            f"Sobol' indices need the package SALib ({error}): pip install 'emclutch[sensitivity]'"
        ) from None
    step = len(names) + 2
    squares = np.asarray(noise, dtype=float) ** 2
    own = np.concatenate([torque[::step], torque[step - 1 :: step]])
    variance = float(own.var())
    share = float(np.concatenate([squares[::step], squares[step - 1 :: step]]).mean()) / variance
    if not share < 1.0:
        raise OutputError(
            f"the replicas' noise is {100.0 * share:.3g} % of the torques' variance; take wider ranges, longer runs or "
            "more replicas of each point (scene.seed)"
        )
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    found = sobol.analyze(
        problem, np.asarray(torque, dtype=float), calc_second_order=False, num_resamples=RESAMPLES, conf_level=0.95,
        seed=0,
    )  # fmt: skip
    rows = []
    for place, name in enumerate(names):
        in_total = 0.5 * float((squares[::step] + squares[place + 1 :: step]).mean()) / variance
        rows.append({
            "value": name,
            "first": float(found["S1"][place]) / (1.0 - share),
            "first_bar": float(found["S1_conf"][place]) / (1.0 - share),
            "total": (float(found["ST"][place]) - in_total) / (1.0 - share),
            "total_bar": float(found["ST_conf"][place]) / (1.0 - share),
            "noise": share,
        })  # fmt: skip
    return rows


def _points(study: StudySection, table: Any) -> tuple[np.ndarray, np.ndarray]:
    """Mean torque and its standard error of each point of the sample, (n,) and (n,)."""
    keys = [key for key in study.values if key != SEED]
    if others := [key for key in keys if key not in study.sample.over and len(study.values[key]) > 1]:  # type: ignore[union-attr]
        raise OutputError(
            f"{study.path} lists {', '.join(others)} beside its sample: that is several studies; make one for each"
        )
    seed = [SEED] if SEED in study.values else []
    runs = {
        (_key(row, keys), _key(row, seed)): (float(row["torque"]), float(row["standard_error"]))
        for _, row in table.iterrows()
    }
    points = [_key(point, keys) for point in study.points() if point.get(SEED) == study.values.get(SEED, [None])[0]]
    replicas = list(dict.fromkeys(_key(point, seed) for point in study.points()))
    missing = sum((point, replica) not in runs for point in points for replica in replicas)
    if missing > 0:
        raise OutputError(f"{missing} runs of {study.path} are not done: continue the study with --resume")
    found = np.array([[runs[point, replica] for replica in replicas] for point in points])
    torques, errors = found[..., 0], found[..., 1]
    means = torques.mean(axis=1)
    if len(replicas) > 1:
        own = torques - torques[:, :1]  # exactly 0 where replicas are alike
        own = own - own.mean(axis=0)
        own = own - own.mean(axis=1, keepdims=True)
        square = float((own**2).sum()) / ((len(points) - 1) * (len(replicas) - 1))
        noise = np.full(len(points), np.sqrt(square / len(replicas)))
    else:
        noise = errors[:, 0]
    if not (np.isfinite(means).all() and np.isfinite(noise).all()):
        raise OutputError("torques or their standard errors are not known: run longer, or list two scene.seed")
    return means, noise


def _key(row: Any, keys: list[str]) -> str:
    """The values of a point, alike in a study's file and in its table."""
    return repr([str(row[key]) for key in keys])
