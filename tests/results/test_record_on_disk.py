"""The changes of a record arrive whole or not at all, whenever the process is killed and the disk is full."""

import numpy as np
import pytest
from full_disk import full_disk

from emclutch.results import atomic_file
from emclutch.results import record as record_module
from emclutch.results.record import Record


class Killed(BaseException):
    """Nothing catches it, as nothing catches SIGKILL."""


@pytest.mark.parametrize("call", range(1, 4))
def test_killed_anywhere_in_a_change_a_record_is_the_old_or_the_new_one(tmp_path, monkeypatch, call):
    """Before its n-th step on the disk the process dies: whoever opens the record finds one of the two."""
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.zeros((2, 3))})
    before, steps = path.read_bytes(), []

    def dies(real):
        def step(*arguments, **more):
            steps.append(real)
            if len(steps) == call:
                raise Killed
            return real(*arguments, **more)

        return step

    for module, name in ((record_module.shutil, "copyfile"), (atomic_file.os, "fsync"), (atomic_file.os, "replace")):
        monkeypatch.setattr(module, name, dies(getattr(module, name)))
    monkeypatch.setattr(type(path), "unlink", lambda path, missing_ok: None)  # a process that is killed cleans nothing
    with pytest.raises(Killed):
        record.append_grains(1, 1.0, {"position": np.ones((2, 3))})
    monkeypatch.undo()
    assert path.read_bytes() == before
    with Record.open(path, "a", resume_time=0.0) as again:
        again.append_grains(1, 1.0, {"position": np.ones((2, 3))})
    assert again.frames().tolist() == [0.0, 1.0]


@pytest.mark.parametrize("room", [0, 20_000, 100_000])
def test_a_record_on_a_full_disk_keeps_what_it_has(tmp_path, room):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.zeros((5000, 3))})
        before = path.read_bytes()
        with full_disk(room), pytest.raises(OSError, match="too large"):
            record.append_grains(1, 1.0, {"position": np.random.default_rng(0).random((5000, 3))})
        assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]
        record.append_grains(1, 1.0, {"position": np.ones((5000, 3))})
    assert record.frames().tolist() == [0.0, 1.0] and record.grains(0)["position"].max() == 0.0


def test_rows_that_are_kept_back_are_written_with_the_next_flush(tmp_path):
    with Record.open(tmp_path / "run.h5", "w") as record:
        for number in range(100):
            record.append_observables({"time": 0.1 * number, "current": float(number)})
        record.flush()
        assert len(record.observable("current")[1]) == 100
        record.append_observables({"time": 10.0, "current": 100.0})
    assert record.observable("current")[1].tolist() == list(range(101))
