"""What a study promises, whatever happens to its processes: by commands alone, so that any engine can be held to it.

The points of every study here are those of one that ran undisturbed in this process, to the last bit. A point's folder
is the one that the table names; how processes share the points, and by which files, is left open.
"""

import signal

import pytest
from killed_run import differences
from promised_study import FATAL, Commands, failures, off, points_of, study_in, until

import emclutch

pytestmark = pytest.mark.slow
HOW = ["--jobs", pytest.param("--dask", marks=pytest.mark.stability)]



@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The points of the study that nothing has disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    out = emclutch.sweep(emclutch.read_study(study_in(folder)), out=folder / "out", threads=1)
    assert len(emclutch.load_study(out).points) == 3 and failures(out) == []
    return points_of(out)


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """A scheduler without workers."""
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    commands = Commands(tmp_path_factory.mktemp("scheduler"))
    try:
        yield commands.scheduler()[1]
    finally:
        commands.end()


@pytest.fixture
def commands(tmp_path):
    begun = Commands(tmp_path)
    try:
        yield begun
    finally:
        begun.end()


@pytest.fixture
def study(tmp_path):
    return study_in(tmp_path)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def ends_well(*calls):
    """All of them end, at least one because the study is done; others may share the work, or say why they do not."""
    codes = [call.code() for call in calls]
    said = "\n".join(call.said for call in calls)
    assert 0 in codes, said
    assert all(code == 0 or call.said.strip() for code, call in zip(codes, calls, strict=True))
    assert "Traceback" not in said


@pytest.mark.stability  # in the gate: the worker that was cut off
def test_points_of_a_killed_worker_are_done_by_another_one(commands, address, study, out, whole):
    killed = commands.worker(address)
    call = commands.sweep(study, out, "--dask", address)
    call.until_in_the_middle(out)
    killed.kill(alone=True)
    commands.worker(address)
    assert call.code() == 0, call.said
    assert off(out, whole) == []


def test_a_killed_study_goes_on_with_another_number_of_jobs(commands, study, out, whole):
    """At first the process that the user has started is killed alone, then all processes of the study."""
    first = commands.sweep(study, out, "--jobs", "2")
    first.until_in_the_middle(out)
    first.kill(alone=True)
    second = commands.sweep(study, out, "--resume", "--jobs", "1")
    second.until_in_the_middle(out)
    second.kill()
    ends_well(commands.sweep(study, out, "--resume", "--jobs", "2"))
    assert off(out, whole) == []


def test_of_two_calls_in_one_folder_nothing_is_lost(commands, study, out, whole):
    """Two begin at the same time, one comes in the middle."""
    first = [commands.sweep(study, out, "--jobs", "1") for _ in range(2)]
    until(lambda: out.is_dir() and any(out.rglob("history.csv")))
    ends_well(*first, commands.sweep(study, out, "--resume", "--jobs", "1"))
    assert off(out, whole) == []


def test_results_of_a_scene_that_was_changed_are_never_those_of_the_new_one(commands, study, out, whole):
    """The scene's file is edited when one point is done and another one has begun."""
    first = commands.sweep(study, out, "--jobs", "1")
    until(lambda: any(out.rglob("summary.json")))
    first.until_in_the_middle(out)
    first.kill()
    scene = study.with_name("scene.toml")
    text = scene.read_text()
    scene.write_text(text.replace("direction = [0, -1, 0]", "direction = [0, 0, -1]"))
    assert scene.read_text() != text
    again = commands.sweep(study, out, "--resume", "--jobs", "1")
    if again.code() == 0:
        expected = points_of(emclutch.sweep(study, out=out.with_name("fresh"), threads=1))
        assert off(out, expected) == [] and expected.keys() == whole.keys() and expected != whole
    else:
        assert again.said.strip() and "Traceback" not in again.said
        assert all(whole[name] == value for name, value in points_of(out).items())


@pytest.mark.stability  # in the gate: the worker that was cut off
def test_one_process_two_and_a_cluster_give_the_same_bits(commands, address, study, out, whole):
    commands.worker(address)
    on_dask = commands.sweep(study, out, "--dask", address)
    assert on_dask.code() == 0, on_dask.said
    by_two = commands.sweep(study, out.with_name("two"), "--jobs", "2")
    assert by_two.code() == 0, by_two.said
    assert off(out, whole) == [] and off(out.with_name("two"), whole) == []


def test_a_worker_that_was_cut_off_and_comes_back_does_no_harm(commands, address, study, out, whole):
    """All its processes are stopped until the scheduler has given it up and has another one, and wake then."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:

        def workers():
            return set(client.scheduler_info()["workers"])

        stopped = commands.worker(address)
        (old,) = until(lambda: workers())
        call = commands.sweep(study, out, "--dask", address)
        call.until_in_the_middle(out)
        stopped.send(signal.SIGSTOP)
        try:
            commands.worker(address)
            until(lambda: workers() - {old} and old not in workers())
        finally:
            stopped.send(signal.SIGCONT)
    assert call.code() == 0, call.said
    stopped.until_at_rest()
    assert off(out, whole) == []


@pytest.mark.parametrize("how", HOW)
def test_a_point_that_kills_its_process_fails_alone(commands, study, out, whole, how, request):
    """With a reason; done again without what kills it, the study is whole."""
    fatal = {"FATAL": f"friction = {FATAL}"}
    if how == "--dask":
        address = request.getfixturevalue("address")
        for _ in range(2):
            commands.worker(address, **fatal)
        call = commands.sweep(study, out, "--dask", address)
    else:
        call = commands.sweep(study, out, "--jobs", "2", **fatal)
    assert call.code() != 0, call.said
    ((friction, reason),) = failures(out)
    assert friction == FATAL and len(reason) > 10
    others = {name: value for name, value in whole.items() if not name.startswith(f"{FATAL}: ")}
    assert differences(points_of(out), others) == []
    ends_well(commands.sweep(study, out, "--resume"))
    assert off(out, whole) == []


def test_a_file_system_without_locks_changes_nothing(commands, study, out, whole):
    """A study is killed there, goes on, and is called twice at the same time."""
    unlocked = {"UNLOCKED": str(out)}
    first = commands.sweep(study, out, "--jobs", "2", **unlocked)
    first.until_in_the_middle(out)
    first.kill(alone=True)
    ends_well(*(commands.sweep(study, out, "--resume", "--jobs", "1", **unlocked) for _ in range(2)))
    assert off(out, whole) == []


@pytest.mark.parametrize("how", HOW)
def test_points_of_a_machine_that_died_are_taken_over_by_the_next_call(commands, study, out, whole, how):
    """Of another name, whose processes this one cannot know; on dask scheduler, workers and call are lost with it."""
    there = {"NODE": "node7"}
    if how == "--dask":
        pytest.importorskip("distributed", reason="the extra dask is not installed")
        scheduler, address = commands.scheduler(**there)
        lost = [commands.sweep(study, out, "--dask", address, **there), commands.worker(address, **there), scheduler]
    else:
        lost = [commands.sweep(study, out, "--jobs", "2", **there)]
    lost[0].until_in_the_middle(out)
    for one in lost:
        one.kill()
    if how == "--dask":
        _, address = commands.scheduler()
        commands.worker(address)
        ends_well(commands.sweep(study, out, "--resume", "--dask", address))
    else:
        ends_well(commands.sweep(study, out, "--resume", "--jobs", "1"))
    assert off(out, whole) == []
