"""The two commands of the page on clusters start a scheduler and workers, and its third one runs a study on them."""

import socket
from contextlib import ExitStack, suppress

import pandas
import pytest
from promised_study import Command, failures, study_in, until
from test_documentation import DOCS, blocks, shell_lines

pytest.importorskip("distributed", reason="the extra dask is not installed")
MODULES = {"dask": "dask", "emclutch": "emclutch.cli.main"}  # that the commands run
PAGE = DOCS / "how_to" / "cluster.md"


def line_of_the_page(*words: str, **replaced: str) -> list[str]:
    """The only line of the page with these words, as a module and its arguments; values of the options replaced."""
    lines = [line for language, _, text in blocks(PAGE) if language == "sh" for line in shell_lines(text)]
    (line,) = (line for line in lines if {*words} <= {*line})
    for option, value in replaced.items():
        line[line.index(f"--{option}") + 1] = value
    return [MODULES[line[0]], *line[1:]]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
        return True
    return False


def test_the_commands_of_the_page_run_a_study_on_a_cluster(tmp_path):
    study, out, port = study_in(tmp_path), tmp_path / "study", free_port()
    study.write_text(study.read_text(encoding="utf-8").replace('"1.4 s"', '"0.2 s"'), encoding="utf-8")
    scheduler = line_of_the_page("dask", "scheduler")
    worker = line_of_the_page("dask", "worker", nthreads="1")
    sweep = line_of_the_page("emclutch", "sweep", "--dask", dask=f"tcp://127.0.0.1:{port}", out=str(out))
    assert worker[2] == "tcp://node1:8786"
    worker[2], sweep[2] = f"tcp://127.0.0.1:{port}", str(study)
    with ExitStack() as cluster:

        def begin(*words: str) -> Command:
            command = Command(tmp_path, *words)
            cluster.callback(command.kill)
            return command

        begin(*scheduler, "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        for _ in range(2):
            begin(*worker, "--no-dashboard", "--local-directory", str(tmp_path))
        until(lambda: answers(port))
        call = begin(*sweep)
        assert call.code() == 0, call.said
    assert len(pandas.read_csv(out / "study.csv")) == 3 and failures(out) == []
