"""Measure the speed of rodgen, compared with other libraries and with the limits of the hardware.

python benchmarks/run.py                # the full run, ten minutes; writes README.md and results/
python benchmarks/run.py --only fits    # or axis, ..., diagnose, workbench; the others stay
python benchmarks/run.py --quick        # a short run of a minute or two; writes nothing
python benchmarks/run.py --page         # measures nothing; writes the page and draws its picture of what was measured
"""

from __future__ import annotations

import argparse
import importlib
import json
import time
import warnings

import environments
import report
from contenders import native

PARTS = ("axis", "fits", *report.SUBJECTS)
RESULTS = environments.HERE / "results" / "latest.json"
PAGE = environments.HERE / "README.md"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS, help="measure only this part")
    parser.add_argument("--quick", action="store_true", help="few rounds, no large sizes; writes no page")
    parser.add_argument("--page", action="store_true", help="measure nothing; write the page of results/")
    arguments = parser.parse_args()
    if arguments.page:
        write(json.loads(RESULTS.read_text()))
        return
    warnings.simplefilter("ignore")  # what a peer's package warns of on import is not this script's to repair
    if arguments.only not in report.SUBJECTS:  # these see to their own peers, if any
        environments.ensure(environments.PEERS, environments.HERE / "requirements-peers.txt")
        environments.append_to_path(environments.PEERS)
    facts = report.machine(native.compiler)
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() and not arguments.quick else {}
    for part in [arguments.only] if arguments.only else PARTS:
        started = time.perf_counter()
        print(f"{part}:", flush=True)
        kept[part] = _measure(part, facts, quick=arguments.quick)
        print(f"{part}: {time.perf_counter() - started:.0f} s", flush=True)
        if not arguments.quick:  # after each part: what was measured stays if a later part fails
            RESULTS.parent.mkdir(exist_ok=True)
            kept = {part: kept[part] for part in PARTS if part in kept}
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
    if arguments.quick:
        print(report.compose(kept))
    else:
        write(kept)


def write(kept: dict) -> None:
    """Write the page of what was measured, and draw its picture."""
    from diagnose import picture

    PAGE.write_text(report.compose(kept))
    print(f"{PAGE.relative_to(environments.HERE.parent)} is written.")
    if "diagnose" in kept:
        picture.draw(kept["diagnose"]["growth"], PAGE.parent)


def _measure(part: str, facts: dict[str, str], *, quick: bool) -> dict:
    if part == "axis":
        import axis

        return axis.run(facts, quick=quick)
    found = importlib.import_module(f"{part}.measure").measure(quick=quick)
    return {"machine": report.machine(native.compiler), **found}  # now that its peers are there


if __name__ == "__main__":
    main()
