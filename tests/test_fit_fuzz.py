"""Whatever the machine and the data: a fit gives numbers, or one sentence of what is wrong; no NaN, no traceback.

Machines are drawn with joints, effects and numbers as they come, data with columns that never change, are zero, are
repeated, huge or tiny, and with rows fewer than parameters. A few kinds of machines are drawn again and again with
other numbers, so that their kernels are made once; a few machines have kernels of their own. Warnings are errors here,
as in all tests.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from machine_cases import READINGS, Case, data_for, joint, machine_file, noisy, possible

from rodgen.calibration.fit import fit
from rodgen.errors import RodgenError

QUICK = settings(
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.function_scoped_fixture,
    ],
)
KINDS = ["point", "direction", "distance"]


# machines and data -------------------------------------------------------------------------------------------


def random_machine(seed: int) -> dict[str, Any]:
    """Return a machine of one to three joints with up to three effects."""
    rng = np.random.default_rng([51, seed])
    kind = KINDS[seed % 3]
    joints = []
    for n in range(rng.integers(1, 4)):
        type = str(rng.choice(["revolute", "prismatic"]))
        more = {"travel": [-50.0, 200.0]} if rng.random() < 0.3 else {}
        joints.append(joint(f"J{n}", type, rng.normal(size=3), rng.normal(size=3) * 100, **more))
    freedoms = [f"{j['name']}.{what}" for j in joints for what in ("axis", "point")] + ["target"]
    file = machine_file(
        joints,
        rng.normal(size=(rng.integers(1, 4), 3)) * 100,
        kind=kind,
        frame=str(rng.choice(["free", "machine"])),
        estimate=[name for name in freedoms if rng.random() < 0.5],
        gravity=rng.normal(size=3),
    )
    there = possible(file)
    file["effect"] = [there[i] for i in sorted(rng.permutation(len(there))[: rng.integers(0, 4)])]
    return file


def renumbered(file: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return a machine of the same structure with other numbers, special ones among them."""
    axes = [*np.eye(3), *-np.eye(3), [1, 1, 0], [1, 1, 1], [1, 1e-9, 0]]

    def axis() -> list[float]:
        return [
            float(x) for x in (axes[rng.integers(len(axes))] if rng.random() < 0.5 else rng.normal(size=3))
        ]

    def point() -> list[float]:
        size = rng.choice([0.0, 1e-6, 1.0, 100.0, 1e5])
        return [float(x) for x in rng.normal(size=3) * size]

    joints = [j | {"axis": axis(), "point": point()} for j in file["joint"]]
    directions = file["measured"]["kind"] == "direction"
    targets = [t | {"point": axis() if directions else point()} for t in file["target"]]
    measured = dict(file["measured"])
    if rng.random() < 0.4:
        measured["noise"] = float(10.0 ** rng.uniform(-9, 2))
    if "from" in measured:
        measured["from"] = targets[0]["point"] if rng.random() < 0.2 else point()
    environment = file["environment"] | {"gravity": axis()}
    return file | {"joint": joints, "target": targets, "measured": measured, "environment": environment}


def odd_data(file: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return data of a machine; with some implausible columns."""
    rows = int(rng.choice([1, 2, 3, 5, 12, 30]))
    data = data_for(file, rows, rng, runs=int(rng.integers(1, 3)) if rows > 2 else 1)
    kind = file["measured"]["kind"]
    if rng.random() < 0.5:
        case = Case(file, data)
        with np.errstate(all="ignore"):
            reading = case.simulated(case.sizeable(k for k in case.model.keys if not k.startswith("frame.")))
        if np.isfinite(reading).all():
            reading = noisy(kind, reading, float(rng.choice([0.0, 1e-3])), rng)
            names = [name if kind == "direction" else f"{name} [mm]" for name in READINGS[kind]]
            data |= dict(zip(names, np.abs(reading.T) if kind == "distance" else reading.T, strict=True))
    for name, column in data.items():
        odd = rng.random()
        if column.dtype.kind != "f" or name.startswith(("dir_", "T_", "u")) or odd > 0.25:
            continue
        if odd < 0.08:
            data[name] = np.full(rows, column[0])
        elif odd < 0.12:
            data[name] = np.zeros(rows)
        elif odd < 0.18:
            data[name] = np.repeat(column[: (rows + 2) // 3], 3)[:rows]
        elif odd < 0.23:
            data[name] = column * 10.0 ** rng.uniform(-9, 6)
        else:
            changed = column.copy()
            changed[rng.integers(rows)] = rng.choice([1e9, 1e30, 1e100, 1e300, 5e-324, 1e-30])
            data[name] = changed
    return data


# what comes out ----------------------------------------------------------------------------------------------


def not_finite(part: Any, place: str = "") -> Iterator[str]:
    """Yield the places of numbers that are none."""
    if isinstance(part, dict):
        for key, value in part.items():
            yield from not_finite(value, f"{place}.{key}")
    elif isinstance(part, list):
        for n, value in enumerate(part):
            yield from not_finite(value, f"{place}[{n}]")
    elif isinstance(part, float) and not np.isfinite(part):
        yield f"{place} = {part}"


def check(file: dict[str, Any], data: dict[str, Any], loss: str) -> None:
    try:
        case = Case(file, data)
        found = fit(case.machine, case.observations, loss=loss)
        result, text = found.to_dict(), found.summary()
    except RodgenError as error:
        said = str(error)
        assert said.isprintable()  # one line
        assert "expected" in said or said.endswith(".") or ": " in said
        return
    assert list(not_finite(result)) == []
    json.loads(json.dumps(result, allow_nan=False))
    assert "nan" not in text.split()
    assert found.chi_square >= 0
    if not found.solution.converged:
        assert "NOT CONVERGED" in text


@cache
def family(number: int) -> dict[str, Any]:
    return random_machine(100 + number)


@pytest.mark.thorough
@pytest.mark.parametrize("examples", [12, pytest.param(60, marks=pytest.mark.slow)])
def test_odd_numbers_give_a_result_or_a_sentence(examples):
    @settings(QUICK, max_examples=examples)
    @given(st.integers(0, 3), st.integers(0, 2**32 - 1), st.sampled_from([*["linear"] * 3, "huber"]))
    def each(number, seed, loss):
        rng = np.random.default_rng(seed)
        file = renumbered(family(number), rng)
        check(file, odd_data(file, rng), loss)

    each()


@pytest.mark.thorough
@settings(QUICK, max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_any_machine_gives_a_result_or_a_sentence(seed):
    rng = np.random.default_rng(seed)
    file = random_machine(seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RODGEN_CPU", "numpy")  # quicker to make
        check(file, odd_data(file, rng), "linear")
