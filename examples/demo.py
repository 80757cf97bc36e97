"""All steps on real data: fit a telescope's model, find the effects that it lacks, and add them.

``make demo`` runs it. It uses the command line, as a user would, and writes everything to build/demo.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import subprocess
import time
from pathlib import Path

from rodgen.cli import main as cli
from rodgen.codegen.scripts import load_derivation

HERE = Path(os.path.relpath(Path(__file__).resolve().parent))
MOUNT = HERE / "machines/mount"
OUTPUT = Path(os.path.relpath(HERE / "../build/demo"))


def say(text: str) -> None:
    print(f"\n{text}\n", flush=True)


def run(*arguments: object) -> None:
    words = [str(argument) for argument in arguments]
    print(f"$ rodgen {' '.join(words)}", flush=True)
    if code := cli.main(words):
        raise SystemExit(code)
    print(flush=True)


def prove() -> None:
    """Run the derivation behind the models; it raises an error if a statement is not proved."""
    start = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # its output is meant for the notebook
        derivation = load_derivation("machine_model")
    proved = sum(entry.verdict == "proved" for entry in derivation)
    print(f"{proved} statements proved in {time.perf_counter() - start:.0f} s: {derivation.title}")


def check_emitted(folder: Path) -> None:
    """Compile the emitted C with its own test, and run it."""
    compiler = next(
        (cc for cc in (os.environ.get("CC"), "cc", "gcc", "clang") if cc and shutil.which(cc)), None
    )
    if compiler is None:
        print("No C compiler: the emitted C is not compiled here.")
        return
    sources = sorted(str(path) for path in folder.glob("*.c"))
    program = str(folder / "test")
    command = [
        compiler,
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        *sources,
        "-lm",
        "-o",
        program,
    ]
    print(f"$ {' '.join(command)} && {program}", flush=True)
    subprocess.run(command, check=True)
    subprocess.run([program], check=True)


def main() -> None:
    shutil.rmtree(OUTPUT, ignore_errors=True)
    OUTPUT.mkdir(parents=True)
    machine, data = MOUNT / "machine.toml", MOUNT / "mmt_2021.csv"
    complete = OUTPUT / "complete.toml"

    say("1. The equations behind the models are proved exactly; in full: rodgen derive machine_model")
    prove()

    say("2. A telescope's mount, two axes and a tube, is fitted to observations of eighty stars.")
    run("fit", machine, data)

    say("3. Where is the model wrong? Its residuals are compared with everything in the data.")
    run("compare", machine, data, "--plot", OUTPUT / "residuals.html")

    say("4. Which physical effect is missing? And which others do these stars not distinguish from it?")
    run("diagnose", machine, data, "-o", complete)

    say(
        "5. That wrote the machine file with the effects found. Its fit has the error to which the steps above fell."
    )
    run("fit", complete, data)

    say("6. The corrected model is written as C for the controller, with a test.")
    run("emit", complete, data, "--lang", "c", "-o", OUTPUT / "c")
    check_emitted(OUTPUT / "c")

    say("7. Everything goes on one page, with the observations that would settle the open questions.")
    run("report", machine, data, "-o", OUTPUT / "report.html")
    print(f"Machine files, plots, C and the page are in {OUTPUT}.")


if __name__ == "__main__":
    main()
