"""The table of `make bench`: ratios, Chrono's scaled times, and a line of the history that can be read back."""

import json

import bench
import bench_rows
import pytest
from bench_rows import Row


def test_a_peer_that_takes_twice_the_time_is_half_as_fast():
    row = Row("work", 10, 1, "processor", "ms", 2.0, "peer", 4.0)
    assert row.faster == 2.0
    assert Row("work", 10, 1, "processor", "ms", 2.0, "peer (not here)").faster is None


def test_chrono_is_scaled_by_the_speed_of_lammps():
    """On a machine where LAMMPS is twice as fast, Chrono takes half the time; without LAMMPS its time is as it was."""
    reported, scaled = bench_rows.chrono(1000, 0.5 * bench_rows.CHRONO_LAMMPS_NS)
    assert scaled == pytest.approx(0.5 * bench_rows.CHRONO_MS[1000])
    assert reported == "Chrono, scaled"
    assert bench_rows.chrono(1000, None) == ("Chrono, not scaled", bench_rows.CHRONO_MS[1000])


def test_every_word_of_a_row_stands_under_its_heading():
    line = Row("work", 10, 2, "wall", "ms a step", 2.0, "peer", 4.0, "remark").in_words()
    for heading, value in (("what", "work"), ("clock", "wall"), ("unit", "ms a step"), ("beside", "peer")):
        assert line.index(value) == bench.HEADER.index(heading)
    assert line.index("remark") > len(bench.HEADER)


def test_a_sitting_is_one_line_that_can_be_read_back():
    rows = [Row("a", 1, 1, "wall", "s", 1.0, "peer", 3.0, "remark"), Row("b", 2, 2, "wall", "s", 1.0, "none")]
    line = bench.as_line({"date": "today", "load_before": 0.5}, rows)
    assert "\n" not in line
    read = json.loads(line)
    assert [row["faster"] for row in read["rows"]] == [3.0, None]
    assert read["date"] == "today" and read["load_after"] >= 0.0
