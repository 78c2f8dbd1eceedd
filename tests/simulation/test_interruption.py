"""Ctrl-C is answered at once where there is no window whose end could be waited for, and while kernels compile."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from emclutch.simulation.kernel_compilation import Compiled, interruptible

ROOT = Path(__file__).resolve().parents[2]
SCENE = """
[scene]
title = "cell"
[geometry]
kind = "shear_cell"
inner_radius = "10 mm"
outer_radius = "11 mm"
height = "1 mm"
[particles]
diameter = "0.3 mm"
solid_fraction = 0.3
[motion.rotor]
speed = "100 rpm"
[time]
end = "1 ms"
[accuracy]
replicas = 1
"""


def test_the_first_ctrl_c_waits_for_the_window_unless_asked_otherwise():
    stop, at_once = threading.Event(), [False]
    with interruptible(stop, lambda: at_once[0]):
        signal.raise_signal(signal.SIGINT)
        assert stop.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    stop.clear()
    at_once[0] = True
    with interruptible(stop, lambda: at_once[0]), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert stop.is_set()
    compiled = Compiled(is_going_on=True)
    with interruptible(stop, lambda: True, compiled):  # a callback of the compiler would lose the exception
        signal.raise_signal(signal.SIGINT)
    assert compiled.stop_asked


def test_ctrl_c_while_kernels_compile(tmp_path):
    """With an empty cache compiling takes half a minute; the run ends before it is done, with exit code 130."""
    (tmp_path / "cell.toml").write_text(SCENE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "emclutch.cli.main", "run", "cell.toml", "--out", "run", "--threads", "1"]
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as run:
        for line in run.stderr:
            if "Compiling the DEM step" in line:
                break
        time.sleep(1.0)
        run.send_signal(signal.SIGINT)
        rest = run.stderr.read()
        assert run.wait(60.0) == 130, rest
        assert "stopped at once" in rest and "--resume" in rest, rest
        assert "Traceback" not in rest and "Exception ignored" not in rest, rest
