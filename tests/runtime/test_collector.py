"""Python's collector of circles rests where nothing is to be found, and nowhere else."""

import gc
import subprocess
import sys
import weakref

import pytest

from runtime.system import collector


class Circle:
    """Garbage that only the collector finds."""

    def __init__(self):
        self.itself = self


def lost_circle():
    return weakref.ref(Circle())


@pytest.mark.parametrize("enabled", [True, False])
def test_modules_are_loaded_while_the_collector_rests_and_it_goes_on_as_before(enabled):
    before = gc.isenabled()
    (gc.enable if enabled else gc.disable)()
    try:
        with collector.loading():
            assert not gc.isenabled()
        assert gc.isenabled() is enabled
        with pytest.raises(ImportError), collector.loading():
            raise ImportError
        assert gc.isenabled() is enabled
    finally:
        (gc.enable if before else gc.disable)()
        gc.unfreeze()


def test_a_process_that_goes_on_keeps_its_collector():
    assert gc.isenabled()
    for _ in range(3):
        collector.leave_circles(2)
    assert gc.isenabled()


def test_a_process_that_ends_with_its_command_collects_every_so_often(monkeypatch):
    monkeypatch.setattr(collector, "_ends_with_its_command", True)
    monkeypatch.setattr(collector, "_left", 0)
    try:
        kept = []
        for _ in range(3):
            collector.leave_circles(3)
            assert not gc.isenabled()
            kept.append(lost_circle())
        assert [circle() is None for circle in kept] == [True, True, False]
    finally:
        gc.enable()


def test_at_its_end_a_process_searches_no_circles_and_keeps_its_exit_code_and_files(tmp_path):
    text = (
        "import atexit, gc, sys\n"
        "from runtime.system.collector import end_without_search\n"
        "end_without_search()\n"
        "class Circle:\n"
        "    def __init__(self): self.itself = self\n"
        "    def __del__(self): print('found', flush=True)\n"
        "circle = Circle()\n"
        "del circle\n"
        "atexit.register(print, 'last words')\n"
        "sys.exit(3)\n"
    )
    ended = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "last words\n", "")
