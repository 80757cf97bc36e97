"""``rodgen completion``: what the shells complete."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., tuple[int, str, str]]
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")


@needs_bash
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rodgen di", "diagnose"),
        ("rodgen mechanism ", "forward reverse"),
        ("rodgen fit --lo", "--loss"),
        ("rodgen fit --loss ", "linear huber"),
        ("rodgen fit mach", "machine.toml"),
        ("rodgen fit machine.toml --loss huber dat", "data.csv"),
        ("rodgen mechanism forward puma_560 points.csv -o dat", "data.csv"),
    ],
)
def test_bash_completes(line: str, expected: str, rodgen_command: Run, tmp_path: Path) -> None:
    code, script, err = rodgen_command("completion", "bash")
    assert (code, err) == (0, "")
    for name in ("machine.toml", "data.csv"):
        (tmp_path / name).touch()
    words = line.split(" ")
    ask = f'\nCOMP_WORDS=("$@")\nCOMP_CWORD={len(words) - 1}\n_shtab_rodgen\necho "${{COMPREPLY[*]}}"'
    done = subprocess.run(
        ["bash", "-c", script + ask, "bash", *words], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert done.stdout == f"{expected}\n"


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script(shell: str, rodgen_command: Run) -> None:
    code, script, _ = rodgen_command("completion", shell)
    assert code == 0
    assert all(word in script for word in ("diagnose", "fit-axis", "apply", "--loss"))
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


def test_completion_says_which_extra_it_needs(rodgen_command: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, _, err = rodgen_command("completion", "bash")
    assert code == 2
    assert "pip install 'rodgen[completion]'" in err
