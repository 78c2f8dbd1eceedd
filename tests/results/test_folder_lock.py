"""One writer a folder: a second one is refused while the first lives, and nothing is left locked when it dies."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import ANY

import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.results import OutputError, RunFolder, folder_lock
from emclutch.results.checkpoint import write_checkpoint
from emclutch.results.folder_lock import LOCK, has_files, locked_folder
from emclutch.scene.case import load_case

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
ROOT = Path(__file__).parents[2]


@pytest.fixture
def holder(tmp_path):
    """Another process that holds tmp_path/run until it is asked to end."""
    code = (
        "import sys; from emclutch.results.folder_lock import locked_folder\n"
        "with locked_folder(sys.argv[1]): print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_a_folder_that_another_process_writes_is_refused_until_that_dies(holder, tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(OutputError, match=rf"is in use by process {holder.pid} on .*, since 20.*wait for it.*--out"):
        with locked_folder(folder):
            pass
    with locked_folder(tmp_path / "other"):  # two folders at once
        pass
    holder.kill()  # no chance to clean up
    holder.wait()
    assert (folder / LOCK).is_file()
    with locked_folder(folder):
        assert json.loads((folder / LOCK).read_text())["pid"] == os.getpid()
        assert not has_files(folder)
    assert not (folder / LOCK).exists()


def test_a_process_that_ends_well_lets_go(holder, tmp_path):
    holder.communicate("")
    assert not any((tmp_path / "run").iterdir())


def test_two_parts_of_one_process_are_two_writers(tmp_path):
    with locked_folder(tmp_path):
        for _ in range(2):  # being refused must not let go of the other's lock
            with pytest.raises(OutputError, match=f"process {os.getpid()} "), locked_folder(tmp_path):
                pass
    with pytest.raises(ZeroDivisionError), locked_folder(tmp_path):
        raise ZeroDivisionError
    with locked_folder(tmp_path):
        pass


def test_a_lock_that_its_holder_removed_in_between_is_none(tmp_path, monkeypatch):
    """A file may be unlinked between our opening and our locking it; who then comes must find ours."""
    path, real, calls = tmp_path / LOCK, folder_lock.fcntl.flock, []
    path.write_text("")

    def late(descriptor, how):
        if not calls:
            path.unlink()
        calls.append(descriptor)
        return real(descriptor, how)

    monkeypatch.setattr(folder_lock.fcntl, "flock", late)
    with locked_folder(tmp_path):
        assert len(calls) == 2 and path.is_file()
        with pytest.raises(OutputError, match="in use"), locked_folder(tmp_path):
            pass


def test_a_holder_whose_folder_was_moved_leaves_the_next_ones_lock(tmp_path):
    with locked_folder(tmp_path / "run"):
        (tmp_path / "run").rename(tmp_path / "aside")
        other = locked_folder(tmp_path / "run")
        other.__enter__()
    with pytest.raises(OutputError, match="is in use by"):
        with locked_folder(tmp_path / "run"):
            pass
    other.__exit__(None, None, None)
    assert not (tmp_path / "run" / LOCK).exists()


def test_without_locks_of_the_file_system_a_process_of_this_machine_that_lives_is_refused(tmp_path, monkeypatch):
    """Its file says which; one that was killed, or is of another machine, has left the folder."""

    def none(descriptor, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(folder_lock.fcntl, "flock", none)
    with locked_folder(tmp_path):
        with pytest.raises(OutputError, match=f"in use by process {os.getpid()} "), locked_folder(tmp_path):
            pass
        held = json.loads((tmp_path / LOCK).read_text())
    for other in ({"began": "1"}, {"pid": 2**22 + 1}, {"host": "node7"}):
        (tmp_path / LOCK).write_text(json.dumps(held | other))
        with locked_folder(tmp_path):
            assert json.loads((tmp_path / LOCK).read_text()) == held | {"since": ANY}
    assert not (tmp_path / LOCK).exists()


def test_a_place_that_cannot_be_written_is_explained(tmp_path):
    (tmp_path / "file").write_text("")
    for folder, words in ((tmp_path / "file", "is a file"), (tmp_path / "file" / "below", r"cannot write to .*--out")):
        with pytest.raises(OutputError, match=words), locked_folder(folder):
            pass


def _study(folder):
    path = folder / "study.toml"
    path.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\ncoil.current = ["0.1 A"]\n')
    return str(path)


@pytest.mark.parametrize("command", ["run", "run --resume", "sweep", "sweep --resume", "accuracy", "mesh"])
def test_every_command_that_writes_asks_for_the_folder(command, tmp_path):
    folder = tmp_path / "used"
    name, _, resume = command.partition(" ")
    case = load_case(GOOD)
    if command == "run --resume":
        write_checkpoint(RunFolder.create(folder, case.toml()).checkpoint, {"case": case.toml()})
    source = _study(tmp_path) if name == "sweep" else str(GOOD)
    with locked_folder(folder):
        before = sorted(folder.iterdir())
        refused = CliRunner().invoke(app, [name, source, "--out", str(folder), *resume.split()])
        assert refused.exit_code == 2 and f"in use by process {os.getpid()} " in refused.output, refused.output
        assert sorted(folder.iterdir()) == before
