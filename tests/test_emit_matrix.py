"""Emitted code of every template and example, in each frame and by each instrument, against predictions and simulators.

The lists come from the registries: a new template, option or form of `emit` without a cell fails. Places are some
1000 mm away and made by some hundred roundings, 1e-11 mm if they all added up; a platform's pose amplifies them by less
than 10, and a step of Newton's leaves 1e-6 mm of what a leg gives way.
"""

from __future__ import annotations

import ctypes
import subprocess
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from emitted_cells import EXAMPLES, Cell, cells

from rodgen.machines.emit._content import Content, content_of
from rodgen.machines.emit._render import render
from rodgen.machines.emit._scope import scope_of

pytestmark = pytest.mark.xdist_group("emit_matrix")
CELLS = cells()
FAST = [
    name for name in CELLS if not name.startswith("example") or name.endswith(("_mount-machine", "-tool"))
]
WITHIN = 1e-9
GIVES_WAY = 1e-5
REACHED = 2e-8


@pytest.fixture(autouse=True, scope="module")
def on_numpy() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RODGEN_CPU", "numpy")
        yield


@cache
def cell(name: str, *, whole: bool = False) -> Cell:
    return Cell(*CELLS[name], whole=whole)


_CONTENTS: dict[str, Content] = {}


@cache
def content(name: str, *, whole: bool = False) -> Content:
    """Return the content of the files of a cell; where the same machine is emitted, that of the other cell."""
    case = cell(name, whole=whole)
    travel = case.observations.travel
    scope = scope_of(case.fitted, travel)
    own = {key: case.values[key] for key in scope.model.keys if key in case.values}
    measured = scope.machine.measured
    key = repr((scope.machine.joints, scope.machine.targets, measured.kind, measured.frame, measured.instrument,
                scope.machine.effects, scope.machine.estimate, scope.machine.kinematics, own, travel))  # fmt: skip
    if key not in _CONTENTS:
        _CONTENTS[key] = content_of(case.fitted, f"device_{len(_CONTENTS)}", travel)
    return _CONTENTS[key]


@cache
def by_numpy(made: int) -> Any:
    text = render(_made[made], "numpy")[f"{_made[made].name}.py"]
    module = SimpleNamespace()
    exec(compile(text, f"{_made[made].name}.py", "exec"), module.__dict__)
    return module


_made: dict[int, Content] = {}


def numpy_of(name: str, *, whole: bool = False) -> Any:
    made = content(name, whole=whole)
    _made[id(made)] = made
    return by_numpy(id(made))


def conditions(name: str, *, whole: bool = False) -> dict[str, np.ndarray]:
    """Return the conditions of the rows as the NumPy functions take them, in the order of the C struct."""
    o = cell(name, whole=whole).observations
    warm = [o.temperature.get(joint.name, np.zeros(o.n)) for joint in o.machine.joints]
    known = {"s": o.s, "v": o.v, "T": np.stack(warm, -1), "t": o.t, "load": o.load}
    return {field.name: np.asarray(known[field.name], float) for field in content(name, whole=whole).fields}


def within(name: str) -> float:
    soft = any(block["name"] == "leg_compliance" for block in cell(name).file["effect"])
    return GIVES_WAY if soft else WITHIN


class Compiled:
    """The functions of a machine in a library of many."""

    def __init__(self, library: ctypes.CDLL, name: str, numbers: int) -> None:
        self.function = lambda what: getattr(library, f"{name}_{what}")
        self.numbers = numbers

    def forward(self, q: np.ndarray, target: Any, given: dict[str, np.ndarray]) -> np.ndarray:
        rows = np.ascontiguousarray(np.hstack([q, *(x.reshape(len(q), -1) for x in given.values())]))
        places = np.empty((len(q), self.numbers))
        for row, t, place in zip(rows, target, places, strict=True):
            self.function("forward")(at(row), int(t), at(place))
        return places

    def compensate(
        self, wanted: np.ndarray, q: np.ndarray, target: Any, given: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        rows = np.ascontiguousarray(np.hstack([q, *(x.reshape(len(q), -1) for x in given.values())]))
        wanted, corrected, status = np.ascontiguousarray(wanted), np.empty(q.shape), np.empty(len(q), int)
        for i, (row, t) in enumerate(zip(rows, target, strict=True)):
            left = ctypes.byref(ctypes.c_double())
            status[i] = self.function("compensate")(
                at(row), int(t), at(wanted[i]), None, at(corrected[i]), left
            )
        return corrected, status


def at(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


@pytest.fixture(scope="module")
def library(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The C of all fast cells, compiled at once."""
    folder = tmp_path_factory.mktemp("matrix")
    names = set()
    for name in FAST:
        made = content(name)
        if made.name not in names:
            names.add(made.name)
            for file, text in render(made, "c").items():
                if not file.endswith("_test.c"):
                    (folder / file).write_text(text)
    sources = sorted(str(path) for path in folder.glob("*.c"))
    command = [compiler, "-std=c99", "-O0", "-fPIC", "-shared", *sources, "-o", str(folder / "all.so"), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


def test_every_example_and_each_instrument_and_frame_has_a_cell():
    assert {path.parent.name for path in EXAMPLES.glob("*/machine.toml")} <= {
        name.removeprefix("example_").partition("-")[0] for name in CELLS if name.startswith("example")
    }
    for name in CELLS:
        assert name.replace("-free", "-machine") in CELLS
        if name.endswith("-tool"):
            assert name.replace("-tool", "-workpiece") in CELLS
    assert len(CELLS) > 80


@pytest.mark.parametrize("name", FAST)
def test_emitted_code_moves_the_machine_that_was_fitted(name, library):
    """Where it is, as the simulator and the prediction have it, and the commands that bring it where it should be."""
    case, code, given = cell(name), numpy_of(name), conditions(name)
    q, target = case.observations.q, case.observations.target
    places = code.forward(q, target, **given)
    real = case.places(q, case.own())
    assert np.abs(places - real).max() <= within(name)
    assert np.abs(case.read(places) - case.predicted()).max() <= within(name)
    nominal = case.ideal(q)
    assert np.abs(real - nominal).max() > 1e-3 if case.machine.measurand.moving else 1e-6
    wanted = code.ideal(q, target)
    assert np.abs(wanted - nominal).max() <= WITHIN

    corrected, status, distance = code.compensate(wanted, q, target, **given)
    reached = case.places(corrected, case.own())
    left = np.linalg.norm(reached - nominal, axis=1)
    assert np.abs(left - distance)[distance < 1].max() <= REACHED + 10 * within(name)
    assert set(status.tolist()) <= {code.CONVERGED, code.NEAREST, code.OUT_OF_TRAVEL}
    assert left[status == code.CONVERGED].max(initial=0.0) <= REACHED + 10 * within(name)
    assert (left <= np.linalg.norm(real - nominal, axis=1) + REACHED).all()

    c = Compiled(library, content(name).name, content(name).numbers)
    assert np.abs(c.forward(q, target, given) - places).max() <= WITHIN
    by_c, status_c = c.compensate(wanted, q, target, given)
    assert (status_c == status).all()
    assert np.abs(by_c - corrected)[status == code.CONVERGED].max(initial=0.0) <= 1e-6
