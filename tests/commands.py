"""Run commands of rodgen: in this process, which has everything imported, or in one of their own."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rodgen.cli.main import main


def run(*arguments: object, stdin: str = "", folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which takes a tenth of the time of one of its own."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(3)]
    streams[0].write(stdin)
    streams[0].seek(0)
    command = [str(argument) for argument in arguments]
    with pytest.MonkeyPatch.context() as patch:
        if folder is not None:
            patch.chdir(folder)
        patch.setattr(sys, "stdin", streams[0])
        patch.setattr(sys, "dont_write_bytecode", True)  # the next script of a name may be as long and as old
        with contextlib.redirect_stdout(streams[1]), contextlib.redirect_stderr(streams[2]):
            code = main(command)
    out, err = (stream.buffer.getvalue().decode() for stream in streams[1:])
    return subprocess.CompletedProcess(command, code, out, err)


def run_process(
    *arguments: object, stdin: Any = "", folder: Path | None = None, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command as a user does, in a process of its own."""
    given = {"input": stdin} if isinstance(stdin, str) else {"stdin": stdin}
    return subprocess.run(
        [sys.executable, "-m", "rodgen", *map(str, arguments)],
        capture_output=True, text=True, timeout=120, check=False, cwd=folder, **given, **options,
    )  # fmt: skip


def words(command: str, machine: str, data: str, folder: str | Path) -> list[str]:
    """Return a call of a command that reads measurements, with what else it wants; outputs go into a folder."""
    further = {
        "predict": [data, "-o", f"{folder}/p.csv"],
        "plan": ["-n", "1", "--for", "C.axis.a"],
        "add": ["-o", f"{folder}/more.toml", "--joint", "C"],
        "emit": ["--lang", "numpy", "-o", str(folder)],
        "report": ["-o", f"{folder}/page.html"],
    }
    effect = ["backlash"] if command == "add" else []
    return [command, machine, *effect, data, *further.get(command, [])]
