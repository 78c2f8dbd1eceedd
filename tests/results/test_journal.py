"""A file whose changes arrive whole or not at all, whenever the process is killed and the disk is full."""

import random

import numpy as np
import pytest
from full_disk import full_disk

from emclutch.results import OutputError, journal
from emclutch.results.journal import PAGE, JournalledFile, journal_of
from emclutch.results.record import Record


def changed(path, seed):
    """A file with random changes over borders of pages, and the bytes that it must have then."""
    chance, expected = random.Random(seed), bytearray(path.read_bytes())
    file = JournalledFile(path)
    for _ in range(40):
        if chance.random() < 0.15:
            size = chance.randint(0, 3 * PAGE)
            expected = expected[:size] + bytes(max(0, size - len(expected)))
            file.truncate(size)
            continue
        at, content = chance.randint(0, 3 * PAGE), chance.randbytes(chance.choice([1, 7, PAGE, PAGE + 5]))
        expected += bytes(max(0, at + len(content) - len(expected)))
        expected[at : at + len(content)] = content
        file.seek(at)
        assert file.write(content) == len(content)
    return file, bytes(expected)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_file_that_it_would_be_without_a_journal(tmp_path, seed):
    path = tmp_path / "file"
    path.write_bytes(random.Random(seed).randbytes(2 * PAGE + 100))
    before = path.read_bytes()
    file, expected = changed(path, seed)
    file.seek(0)
    assert file.read() == expected and path.read_bytes() == before
    file.commit()
    assert path.read_bytes() == expected and [each.name for each in tmp_path.iterdir()] == ["file"]
    with JournalledFile(path) as again:
        again.commit()  # nothing to do
        assert again.read() == expected


class Killed(BaseException):
    """Nothing catches it, as nothing catches SIGKILL."""


@pytest.mark.parametrize("call", range(1, 7))
def test_killed_anywhere_in_a_commit_it_is_the_old_or_the_new_one(tmp_path, monkeypatch, call):
    """Before its n-th call of the disk the process dies: whoever opens the file finds one of the two, and goes on."""
    path = tmp_path / "file"
    path.write_bytes(random.Random(1).randbytes(3 * PAGE))
    before = path.read_bytes()
    file, expected = changed(path, 1)
    calls = []

    def dies(real):
        def step(*arguments, **more):
            calls.append(real)
            if len(calls) == call:
                raise Killed
            return real(*arguments, **more)

        return step

    for module, name in ((journal.os, "fsync"), (journal.os, "replace")):
        monkeypatch.setattr(module, name, dies(getattr(module, name)))
    monkeypatch.setattr(type(path), "open", dies(type(path).open))
    monkeypatch.setattr(type(path), "unlink", dies(type(path).unlink))
    died = False
    try:
        file.commit()
    except Killed:
        died = True
    monkeypatch.undo()
    assert died == (call <= len(calls))
    with JournalledFile(path) as found:
        content = found.read()
        assert content in (before, expected)
        found.commit()
    assert path.read_bytes() == content and not journal_of(path).exists()


def test_half_written_pages_are_those_of_the_journal(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(bytes(3 * PAGE))
    file = JournalledFile(path)
    file.write(b"x" * (2 * PAGE))
    real, file._path = file._path, tmp_path / "none"
    with pytest.raises(FileNotFoundError):  # the journal is there, the file has none of it
        file.commit()
    path.write_bytes(b"x" * PAGE + b"half" + bytes(2 * PAGE - 4))
    assert journal_of(real).is_file()
    with JournalledFile(real) as found:
        assert found.read() == b"x" * (2 * PAGE) + bytes(PAGE)


def test_a_record_on_a_full_disk_keeps_what_it_has(tmp_path):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.zeros((5000, 3))})
        before = path.read_bytes()
        with full_disk(20_000), pytest.raises(OSError, match="too large"):
            record.append_grains(1, 1.0, {"position": np.random.default_rng(0).random((5000, 3))})
        assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]
        record.append_grains(1, 1.0, {"position": np.ones((5000, 3))})
    assert record.frames().tolist() == [0.0, 1.0] and record.grains(0)["position"].max() == 0.0


@pytest.mark.parametrize("content", [b"", b"no journal", b"PK\x03\x04 half"])
def test_a_journal_of_something_else_makes_no_record(tmp_path, content):
    path = tmp_path / "run.h5"
    with Record.open(path, "w") as record:
        record.append_grains(0, 0.0, {"position": np.zeros((1, 3))})
    journal_of(path).write_bytes(content)
    with pytest.raises(OutputError, match=r"run\.h5\.journal is no journal of changes"):
        Record.open(path)
    with Record.open(path, "a", resume_time=1.0) as again:  # a run goes on, and the old one is kept
        again.append_grains(2, 2.0, {"position": np.zeros((1, 3))})
    assert again.frames().tolist() == [2.0] and (tmp_path / "run-broken-1.h5").is_file()
