"""Ctrl-C ends a command within a second, wherever it is, and leaves nothing behind."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rodgen.cli import main as cli
from rodgen.files import publish_outputs, write_file

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")

MOUNT = Path(__file__).parent.parent / "examples" / "machines" / "mount"
FILES = (str(MOUNT / "machine.toml"), str(MOUNT / "mmt_2021.csv"))
LINE = "rodgen: interrupted; no file was written\n"
AT_STAGE = """
import sys
from rodgen import stages
from rodgen.cli.main import main
class Listener:
    def begin(self, what, total):
        if what == {stage!r}:
            print("begun", file=sys.stderr, flush=True)
    def step(self, done): pass
    def end(self): pass
with stages.listening(Listener()):
    sys.argv[1:] = {arguments!r}
    sys.exit(main())
"""


def interrupted(code, folder, wait_for, **environment):
    """Run Python code in a folder, interrupt it when something holds; return its exit code and what it wrote."""

    def take_interrupts():  # a test run in the background ignores them, and so would its children
        signal.signal(signal.SIGINT, signal.default_int_handler)

    for name in ("work", "temporary", "cache"):
        (folder / name).mkdir()
    places = {"RODGEN_CACHE": str(folder / "cache"), "TMPDIR": str(folder / "temporary")}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder / "work",
        env={**os.environ, **places, **environment}, preexec_fn=take_interrupts,
    ) as command:  # fmt: skip
        wait_for(command)
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=60)
    return command.returncode, out, err.replace("begun\n", "")  # where the stage began again, too


def test_an_interrupt_while_commands_are_imported_is_one_line(tmp_path):
    code = """
import builtins, sys
import rodgen.__main__
imported = builtins.__import__
def interrupted(name, *others):
    if name == "rodgen.cli.main":
        raise KeyboardInterrupt
    return imported(name, *others)
builtins.__import__ = interrupted
sys.exit(rodgen.__main__.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", LINE)


@pytest.mark.parametrize("ending", ["SIGTERM", "SIGHUP"])
def test_a_signal_that_ends_a_command_leaves_no_temporary_file(ending, tmp_path):
    code = f"""
import os, signal, sys
from rodgen.cli import effects, main
from rodgen.files import write_file
def run(options):
    write_file("c.toml", b"1")
    os.kill(os.getpid(), signal.{ending})
effects._run = run
signal.signal(signal.{ending}, signal.SIG_DFL)  # a test run that ignores it would have its children ignore it
sys.argv[1:] = ["effects"]
sys.exit(main.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path
    )
    line = "rodgen: ended by a signal; no file was written\n"
    assert (done.returncode, done.stdout, done.stderr) == (143, "", line)
    assert os.listdir(tmp_path) == []


def begun(command):
    assert command.stderr.readline() == "begun\n"


@pytest.mark.thorough
@pytest.mark.quick("fitting")
@pytest.mark.parametrize("stage", ["reading", "fitting", "testing effects", "error on poses left out"])
def test_a_diagnosis_ends_at_any_stage(stage, tmp_path):
    code = AT_STAGE.format(stage=stage, arguments=["diagnose", *FILES])
    assert interrupted(code, tmp_path, begun) == (130, "", LINE)
    assert os.listdir(tmp_path / "temporary") == []
    assert [name for name in os.listdir(tmp_path / "cache") if name.startswith("build-")] == []


@pytest.mark.thorough
def test_the_compiler_ends_with_the_programs_that_it_runs(tmp_path):
    """A compiler that starts another program and waits for it, as cc does with cc1."""
    compiler = tmp_path / "cc"
    compiler.write_text(
        f'#!/bin/sh\ncase "$*" in *--version*|*-dM*) exec cc "$@";; esac\n'
        f"sleep 300 & echo $! > {shlex.quote(str(tmp_path))}/child\ntouch $TMPDIR/part\nwait\n"
    )
    compiler.chmod(0o755)

    def compiling(command):
        for _ in range(600):
            if (tmp_path / "child").exists() and (tmp_path / "child").read_text():
                return
            time.sleep(0.05)
        raise AssertionError("the compiler was never called")

    code = AT_STAGE.format(stage="", arguments=["fit", *FILES, "-o", "fitted.toml"])
    code = f"import rodgen.calibration.fit as fit\nfit.COMPILE_FROM = 0\n{code}"
    found = interrupted(code, tmp_path, compiling, CC=str(compiler), RODGEN_CPU="")
    assert found == (130, "", LINE)
    child = int((tmp_path / "child").read_text())
    for _ in range(100):  # until init has taken its exit code
        if not Path(f"/proc/{child}").exists() or b"Z" in Path(f"/proc/{child}/stat").read_bytes().split()[2]:
            break
        time.sleep(0.05)
    else:
        raise AssertionError("the compiler's child is still there")
    assert [os.listdir(tmp_path / name) for name in ("work", "temporary", "cache")] == [[], [], []]


def test_files_that_were_complete_are_named(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)

    def stop(options):
        write_file("a.toml", b"1")
        write_file("b.toml", b"1")
        publish_outputs()
        write_file("c.toml", b"1")
        raise KeyboardInterrupt

    monkeypatch.setattr("rodgen.cli.effects._run", stop)
    assert cli.main(["effects"]) == 130
    assert capfd.readouterr() == ("", "rodgen: interrupted; complete: a.toml, b.toml\n")
    assert sorted(os.listdir(tmp_path)) == ["a.toml", "b.toml"]
