"""Time whole diagnoses, each the command in a process of its own with its kernels in the cache, and how they grow."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from fits.cases import EXAMPLES

from diagnose.cases import CASES, GROWING, Chain

REPEATS = 3
MOUNT = "telescope, 80 rows"


def measure(*, quick: bool) -> dict[str, Any]:
    """Return the times and the memory of every case, and of the cases that grow."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        mount = [EXAMPLES / "mount" / name for name in ("machine.toml", "mmt_2021.csv")]
        found = {MOUNT: _case(mount, home, quick=quick) | {"cold": _once(mount, home / "empty")["all"]}}
        for name, chain in CASES.items():
            if not (quick and chain.rows > 1_000):
                found[name] = _chain(chain, home, name, quick=quick)
        growing = {
            of: [
                _chain(chain, home, f"growth with {of}, {n} of {len(chains)}", quick=quick)
                for n, chain in enumerate(chains[: 1 if quick else None], 1)
            ]
            for of, chains in GROWING.items()
        }
    return {"cases": found, "growth": growing, "seconds": round(time.perf_counter() - started)}


def _chain(chain: Chain, home: Path, name: str, *, quick: bool) -> dict[str, Any]:
    *files, parameters = chain.write(Path(tempfile.mkdtemp(dir=home)))
    found = _case(files, home, quick=quick)
    print(f"  {name}: {found['all']:.1f} s", flush=True)
    return {"joints": chain.joints, "rows": chain.rows, "parameters": parameters} | found


def _case(files: Any, home: Path, *, quick: bool) -> dict[str, Any]:
    """Return medians of repeated runs after one that fills the cache."""
    first = _once(files, home / "cache")
    runs = 1 if quick or first["all"] > 20 else REPEATS
    again = [_once(files, home / "cache") for _ in range(runs)]
    return {key: statistics.median(run[key] for run in again) for key in first}


def _once(files: Any, cache: Path) -> dict[str, Any]:
    """Run the command; return its processor seconds, in all and for the start, and its memory, MiB."""
    return _run([*map(str, files), "--json"], cache) | {"start": _run(["--help"], cache)["all"]}


def _run(words: list[str], cache: Path) -> dict[str, Any]:
    # the modules compiled, as where it is installed, whatever this process was told
    modules = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(cache.with_name("modules"))}
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("alone.py"), sys.executable, "-m", "rodgen", "diagnose", *words],
        env=os.environ | modules | {"RODGEN_CACHE": str(cache)}, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)
