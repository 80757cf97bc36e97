"""``rodgen doctor``: what it finds, and when its exit code says that something is broken."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

import rodgen
from rodgen.codegen import build_cache
from rodgen.installation import EXTRAS

PYPROJECT = Path(__file__).parent.parent / "pyproject.toml"
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("RODGEN_CACHE", str(folder))
    return folder


def test_doctor_finds_a_sound_installation(
    cache: Path, rodgen_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    (cache / "a.so").write_bytes(bytes(300))
    (cache / "b.py").write_bytes(bytes(20))
    (cache / "build-x").mkdir()  # left by a process that was killed
    code, out, err = rodgen_command("doctor", "--json")
    found = json.loads(out)
    assert (code, err, found["problems"]) == (0, "", [])
    assert found["rodgen"] == rodgen.__version__
    assert found["kernels"]["instruction_set"] == rodgen.backend
    assert {"folder": str(cache), "entries": 2, "bytes": 320, "writable": True}.items() <= found[
        "cache"
    ].items()
    assert found["threads"]["processors"] >= 1
    assert {"OMP_NUM_THREADS": "1", "RODGEN_CACHE": str(cache)}.items() <= found["environment"].items()
    for name in ("numpy", "scipy", "sympy", "pint", "pyarrow", "plotly", "kaleido"):
        assert found["packages"][name][0].isdigit()
    assert sorted(os.listdir(cache)) == ["a.so", "b.py", "build-x"]

    code, out, _ = rodgen_command("doctor")
    assert code == 0
    assert out.endswith("\nNothing is broken.\n")
    for words in (f"rodgen {rodgen.__version__} on Python", "2 entries, 0.0 MB, writable", "numpy"):
        assert words in " ".join(out.split())  # lines are wrapped
    assert max(map(len, out.splitlines())) <= 120 + len(str(cache))


def test_every_extra_of_the_installation_is_looked_for_by_the_module_that_is_imported(
    cache: Path, rodgen_command: Run
) -> None:
    """The table of modules is that of pyproject.toml; what is installed has the version of its distribution."""
    _, out, _ = rodgen_command("doctor", "--json")
    found = json.loads(out)["packages"]
    owners = importlib.metadata.packages_distributions()
    extras = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    required = {extra: {_name(text) for text in extras[extra]} for extra in {*EXTRAS.values()}}
    for module, extra in EXTRAS.items():
        if importlib.util.find_spec(module) is None:
            assert found[module] is None
            continue
        (owner,) = {*owners[module]}
        assert found[module] == importlib.metadata.version(owner)
        behind = {_name(text) for name in required[extra] for text in importlib.metadata.requires(name) or ()}
        assert _name(owner) in required[extra] | behind  # such as choreographer, which Kaleido needs
    known = {_name(owner) for module in EXTRAS for owner in owners.get(module, [module])}
    assert set().union(*required.values()) - {"rodgen"} <= known


def _name(requirement: str) -> str:
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")


def test_doctor_says_that_there_is_no_compiler(
    cache: Path, rodgen_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    code, out, _ = rodgen_command("doctor")
    assert code == 0
    assert "compiler     none: kernels run on NumPy\n" in out


def test_doctor_fails_where_the_compiler_does(
    cache: Path, rodgen_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "not-a-compiler")
    code, out, _ = rodgen_command("doctor")
    assert code == 1
    assert out.splitlines()[-1].startswith("compiler: CC names the compiler 'not-a-compiler', which")
    monkeypatch.setenv("CC", f"{sys.executable} -S")  # it has a --version, and compiles nothing
    code, out, _ = rodgen_command("doctor")
    assert code == 1
    assert out.splitlines()[-1].startswith(f"compiler: {sys.executable} fails: ")


def test_doctor_fails_where_the_cache_cannot_be_used(
    tmp_path: Path, rodgen_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("RODGEN_CACHE", str(tmp_path / "file" / "cache"))
    code, out, _ = rodgen_command("doctor")
    assert code == 1
    assert f"cache: {tmp_path}/file/cache: it cannot be made (Not a directory), so" in out
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    monkeypatch.setenv("RODGEN_CACHE", str(open_to_all))
    code, out, _ = rodgen_command("doctor", "--json")
    assert code == 1
    assert not json.loads(out)["cache"]["writable"]
    assert build_cache.cache_problem() == "other users may write to it"


def test_doctor_fails_where_the_extension_does_not_load(cache: Path) -> None:
    """The extension is there, and is no library."""
    code = (
        "import importlib.machinery, importlib.util, sys\n"
        "real = importlib.util.find_spec\n"
        "place = importlib.machinery.ModuleSpec('rodgen._gufuncs', None, origin='/x/_gufuncs.so')\n"
        "importlib.util.find_spec = lambda name, *p: place if name == 'rodgen._gufuncs' else real(name, *p)\n"
        "sys.modules['rodgen._gufuncs'] = None\n"
        "from rodgen.cli.main import main\n"
        "sys.exit(main(['doctor']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")
    assert "kernels      NumPy: the compiled ones do not load\n" in done.stdout
    assert "kernels: /x/_gufuncs.so does not load (" in done.stdout


def test_doctor_needs_numpy_alone(cache: Path) -> None:
    extras = ["sympy", "jinja2", "pint", "pyarrow", "scipy", "threadpoolctl", "plotly", "kaleido"]
    code = (
        "import importlib.metadata, sys\n"
        f"extras = {[*extras, 'choreographer', 'shtab']!r}\n"
        "sys.modules.update(dict.fromkeys(extras))\n"
        "real = importlib.metadata.version\n"
        "def version(name):\n"
        "    if name in extras: raise importlib.metadata.PackageNotFoundError(name)\n"
        "    return real(name)\n"
        "importlib.metadata.version = version\n"
        "from rodgen.cli.main import main\n"
        "sys.exit(main(['doctor']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "no sympy, jinja2: pip install 'rodgen[derive]'\n" in done.stdout
    assert "browser      not looked for: Kaleido is not installed; figures as .html only\n" in done.stdout
