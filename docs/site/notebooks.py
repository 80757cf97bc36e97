"""Execute rodgen's derivations and two examples as notebooks; write them into build/notebooks.

    python docs/site/notebooks.py [-j 2]        # make notebooks; make docs shows the same notebooks as pages

A notebook is executed again when a file that it used has changed: the script, a module of this repository that it
imported, an example's data, or a package that draws or typesets. NAME.json beside NAME.ipynb says which these were.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.metadata import version
from pathlib import Path

from rodgen.codegen.scripts import packaged_derivations, run_notebook, script_path

__all__ = ["EXAMPLES", "FOLDER", "execute_all", "record"]

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build/notebooks"
EXAMPLES = {name: ROOT / f"examples/{name}.py" for name in ("corrected_machine", "off_by_20_um")}
DATA = {"corrected_machine": "examples/machines/mount", "off_by_20_um": "examples/off_by_20_um"}
PACKAGES = ("sympy", "numpy", "scipy", "plotly", "nbclient", "jupytext")

# Runs after the last cell: what the page says about the derivation beyond its cells, and which modules it used.
AFTERWARDS = f"""
import json as _json, sys as _sys
_used = sorted({{getattr(m, "__file__", None) or "" for m in list(_sys.modules.values())}})
_record = {{"files": [f for f in _used if f.startswith({str(ROOT)!r}) and "/.venv" not in f]}}
if "derivation" in globals():
    from rodgen.symbolic import errata as _errata
    _verdicts = [entry.verdict for entry in derivation]
    _record |= {{
        "title": derivation.title,
        "source": derivation.source,
        "entries": [
            {{
                "latex": [*map(derivation.latex, entry.claims)],
                **{{key: getattr(entry, key) for key in ("id", "place", "origin", "verdict")}},
            }}
            for entry in derivation
        ],
        "kernels": {{name: getattr(kernel, "source", "") for name, kernel in derivation.kernels.items()}},
        "kernels_in": derivation.kernels_in,
        "proved": _verdicts.count("proved"),
        "refuted": _verdicts.count("refuted"),
        "errata": _errata(derivation, form="markdown") if "refuted" in _verdicts else "",
    }}
print(_json.dumps(_record))
"""


@cache
def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _versions() -> dict[str, str]:
    return {name: version(name) for name in PACKAGES} | {
        "python": sys.version.split()[0],
        "record": AFTERWARDS,
    }


def _is_fresh(name: str) -> bool:
    if not (FOLDER / f"{name}.ipynb").is_file() or not (FOLDER / f"{name}.json").is_file():
        return False
    found = record(name)
    return found["versions"] == _versions() and all(
        _hash(ROOT / file) == known for file, known in found["files"].items()
    )


def record(name: str) -> dict:
    """Return what is known about an executed notebook: its files, and a derivation's title, source and errata."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def _execute(name: str) -> float:
    start = time.perf_counter()
    script = EXAMPLES.get(name) or script_path(name)
    (FOLDER / f"{name}.json").unlink(missing_ok=True)
    printed = run_notebook(
        str(script) if name in EXAMPLES else name, FOLDER / f"{name}.ipynb", then=AFTERWARDS
    )
    found = json.loads(printed.splitlines()[-1])
    files = {ROOT / file for file in found["files"]} | {script, *(ROOT / DATA.get(name, "-")).glob("*")}
    hashes = {str(file.relative_to(ROOT)): _hash(file) for file in sorted(files)}
    text = json.dumps(found | {"files": hashes, "versions": _versions()}, indent=1)
    (FOLDER / f"{name}.json").write_text(text, encoding="utf-8")
    return time.perf_counter() - start


def execute_all(jobs: int = 1) -> list[str]:
    """Execute the notebooks that are not fresh, and return the names of all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    names = [*packaged_derivations(), *EXAMPLES]
    stale = [name for name in names if not _is_fresh(name)]
    if stale:
        print(f"{len(stale)} of {len(names)} notebooks are executed ...", flush=True)
    with ThreadPoolExecutor(jobs) as pool:
        for number, (name, seconds) in enumerate(zip(stale, pool.map(_execute, stale), strict=True), 1):
            print(f"  {number:2}/{len(stale)}  {name} ({seconds:.0f} s)", flush=True)
    for file in FOLDER.iterdir():
        if file.stem not in names and file.is_file():
            file.unlink()
    if stale:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"  {used.ru_utime + used.ru_stime:.0f} s of processor time", flush=True)
    return names


def main() -> None:
    """Execute the notebooks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-j", "--jobs", type=int, default=1, help="notebooks that run at the same time")
    names = execute_all(parser.parse_args().jobs)
    print(f"{len(names)} notebooks in {FOLDER.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
