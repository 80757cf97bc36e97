"""A session of the workbench: what is done to a machine, undone, done again, saved and replayed."""

import asyncio
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.ladder import ladder
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.workbench.actions import Add, Aside, Back, Known, Remove, Repair, Tie, Written
from rodgen.workbench.keep import file_in
from rodgen.workbench.server import Guard
from rodgen.workbench.session import Session

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"
FLEXURE, REFRACTION = {"name": "tube_flexure"}, {"name": "refraction"}


@pytest.fixture
def files(tmp_path):
    for name in ("machine.toml", "mmt_2021.csv"):
        shutil.copy(MOUNT / name, tmp_path)
    return tmp_path / "machine.toml", tmp_path / "mmt_2021.csv"


@pytest.fixture
def session(files):
    return Session.open(*files)


@pytest.mark.thorough
def test_the_error_of_the_telescope_falls_and_rises_again(session):
    assert session.state.fit.rms == pytest.approx(2.71, abs=0.005)
    assert session.do(Add(FLEXURE)).fit.rms == pytest.approx(0.97, abs=0.005)
    assert session.do(Add(REFRACTION)).fit.rms == pytest.approx(0.66, abs=0.005)
    after = session.state
    assert session.undo().fit.rms == pytest.approx(0.97, abs=0.005)
    assert session.undo().fit.rms == pytest.approx(2.71, abs=0.005)
    assert session.undo() is session.states[0]
    session.redo()
    assert session.redo() is after
    assert session.redo() is after
    found = session.ladder
    assert [rung.title for rung in found.rungs] == ["base", "+ tube_flexure (TF)", "+ refraction (TX)"]
    machine, data = session.states[0].machine, session.state.observations
    same = ladder(machine, data, [machine.effect("tube_flexure"), machine.effect("refraction")])
    for one, other in zip(found.rungs, same.rungs, strict=True):
        assert one.fit.rms == pytest.approx(other.fit.rms, rel=1e-8)
        assert one.held_out.rms == pytest.approx(other.held_out.rms, rel=1e-6)
    last, of_all = found.rungs[-1].step, same.rungs[-1].step
    assert last.needed
    assert of_all.needed


def test_rows_are_set_aside_and_brought_back(refuses, session, files):
    base = session.state
    state = session.do(Aside([3, 4, 17], why="clouds"))
    assert state.observations.data.place(int(np.flatnonzero(state.aside)[0])) == "line 3"
    others = base.fit.refit(base.machine, base.observations.take(~state.aside))
    assert state.fit.rms == pytest.approx(others.rms, rel=1e-8)
    assert str(session.ladder).endswith("3 rows excluded: 3 rows left out.")
    assert 'set_aside = [\n    { rows = "3-4, 17", file = "mmt_2021.csv", check = "' in state.text
    session.save_machine(files[0])
    again = Session.open(*files)  # the machine file keeps them
    assert again.state.numbers[again.state.aside].tolist() == [3, 4, 17]
    assert again.state.fit.rms == pytest.approx(state.fit.rms, rel=1e-9)
    assert Machine.load(files[0]).fit(Measurements.load(files[1])).rms == pytest.approx(
        state.fit.rms, rel=1e-8
    )
    assert session.do(Back([4])).aside.sum() == 2
    assert session.do(Back([3, 17])).fit.rms == pytest.approx(base.fit.rms, rel=1e-9)
    assert session.state.text == base.text
    refuses(session.do, Aside([1]))
    refuses(session.do, Aside(base.numbers.tolist()))
    assert session.at == 3


def test_parameters_are_held_and_bounded(session):
    session.do(Add(FLEXURE))
    free = session.state.fit.estimates["tube_flexure.a"].value
    session.do(Written({**FLEXURE, "hold": {"a": 0.001}}))
    assert session.state.fit.estimates["tube_flexure.a"].held
    assert session.ladder.rungs[-1].fit.rms > session.ladder.rungs[-2].fit.rms  # the model is worse for it
    session.do(Written(FLEXURE))
    assert session.state.fit.estimates["tube_flexure.a"].value == pytest.approx(free, rel=1e-6)
    session.do(Known("tube_flexure.a", {"bounds": ["-1 arcsec", "1 arcsec"]}))
    assert session.state.fit.estimates["tube_flexure.a"].at_bound
    assert '[known]\n"tube_flexure.a" = { bounds = ["-1 arcsec", "1 arcsec"] }\n' in session.state.text
    session.do(Known("tube_flexure.a", {"prior": "0 ± 2 arcsec"}))
    assert session.state.text.count("tube_flexure.a") == 1
    session.do(Known("tube_flexure.a"))
    assert session.state.fit.estimates["tube_flexure.a"].value == pytest.approx(free, rel=1e-6)


def test_parameters_are_tied_and_free_again(refuses, session, tmp_path):
    for joint in ("AZ", "EL"):
        session.do(Add({"name": "encoder_eccentricity", "joint": joint}))
    of, other = "EL.encoder_eccentricity.a", "AZ.encoder_eccentricity.a"
    free = session.state.fit
    tied = session.do(Tie(of, f"-2 * {other} + 3 arcsec")).fit
    values = {key: tied.estimates[key].value for key in (of, other)}
    assert values[of] == pytest.approx(3 - 2 * values[other], rel=1e-9)
    assert tied.rms > free.rms
    assert f'[ties]\n"{of}" = "-2 * {other} + 3 arcsec"\n' in session.state.text
    refuses(session.do, Tie(other, of))
    refuses(session.do, Known(of, {"prior": "0 ± 2 arcsec"}))
    assert session.do(Known(of)).machine.ties.keys() == {of}
    session.do(Tie(of, other))
    assert session.state.text.count(f'"{of}"') == 1
    session.save(tmp_path / "mount.rodgen")
    assert Session.load(tmp_path / "mount.rodgen").state.text == session.state.text
    assert session.do(Tie(of)).fit.rms == pytest.approx(free.rms, rel=1e-8)
    assert session.state.machine.ties == {}


def test_a_formula_of_ones_own_is_added(refuses, session):
    own = {
        "name": "sag",
        "joint": "EL",
        "component": "reading",
        "formula": "k*cos(q)",
        "parameters": {"k": "arcsec"},
    }
    assert session.do(Add(own)).fit.rms == pytest.approx(0.97, abs=0.005)
    refuses(session.do, Add({**own, "name": "other", "formula": "k*cos(q"}))
    assert session.do(Remove("sag", "EL")).fit.rms == pytest.approx(2.71, abs=0.005)


def test_a_session_is_saved_with_every_action_and_replays(refuses, session, files, tmp_path):
    session.save(tmp_path / "mount.rodgen")
    session.do(Add(FLEXURE, why="it bends"))
    session.do(Aside([5]))
    session.do(Add(REFRACTION))
    session.undo()
    session.save_machine(files[0])  # the file of the session differs from now on
    again = Session.load(tmp_path / "mount.rodgen")
    assert (again.at, len(again.states), again.remarks) == (2, 4, [])
    assert again.state.text == session.state.text
    assert again.state.fit.rms == session.state.fit.rms
    assert [s.action for s in again.states[1:]] == [s.action for s in session.states[1:]]
    assert again.redo().fit.rms == session.redo().fit.rms
    files[1].write_text(files[1].read_text().replace("347.2778909", "347.2778908"))
    refuses(Session.load, tmp_path / "mount.rodgen")


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c.update(format=2),
        lambda c: c["machine"].update(text="x = 1"),
        lambda c: c["actions"].append({"do": "delete"}),
        lambda c: c["actions"].append({"do": "add", "effect": "x"}),
        lambda c: c["actions"].append({"do": "add", "effect": {"name": "<script>"}}),
        lambda c: c["actions"].append({"do": "set aside", "rows": [True]}),
        lambda c: c.pop("at"),
    ],
)
def test_a_session_file_that_is_none_is_one_sentence(refuses, session, tmp_path, change):
    file = tmp_path / "mount.rodgen"
    session.save(file)
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
    refuses(Session.load, file)


@pytest.mark.slow
def test_a_repaired_order_of_joints_binds_columns_anew(tmp_path):
    folder = MOUNT.parent / "positioner"
    head, theta, phi = (folder / "machine.toml").read_text().partition("\n[[target]]")[0].split("[[joint]]")
    rest = (folder / "machine.toml").read_text().partition("\n[[target]]")[2]
    wrong = f"{head}[[joint]]{phi}\n[[joint]]{theta}\n[[target]]{rest}"
    (tmp_path / "machine.toml").write_text(wrong)
    session = Session.open(tmp_path / "machine.toml", folder / "data.csv")
    before, repair = session.state.fit.rms, next(m for m in session.state.check.repairs if not m.of_data)
    assert session.do(Repair(repair.words)).fit.rms < 0.1 * before


def test_to_import_rodgen_imports_no_page():
    code = "import sys, rodgen, rodgen.cli.main, rodgen.workbench; print('nicegui' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


# Who may ask the server of the workbench: the window that was given its address, and nobody else


TOKEN, PORT = "abcDEF-123_456", 8123
HOST = ("host", f"127.0.0.1:{PORT}")
ORIGIN = ("origin", f"http://127.0.0.1:{PORT}")


def asked(path=f"/{TOKEN}/", headers=(HOST,), kind="http", body=(b"",)):
    """Return the status and headers of the answer, or how a web socket is closed; and whether the page was reached."""
    sent, reached, parts = [], [], list(body)

    async def page(scope, receive, send):
        reached.append(scope["path"])
        if kind == "http":
            while parts:
                await receive()
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"page"})
        else:
            await send({"type": "websocket.accept"})

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "path": path,
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers],
    }
    asyncio.run(Guard(page, TOKEN, PORT, most=1000)(scope, receive, send))
    return sent[0], bool(reached)


def test_the_window_that_was_given_the_address_is_answered():
    answer, reached = asked()
    assert (answer["status"], reached) == (200, True)
    given = dict(answer["headers"])
    assert b"default-src 'self'" in given[b"content-security-policy"]
    assert b"http" not in given[b"content-security-policy"]  # nothing is asked of any network
    assert b"frame-ancestors 'none'" in given[b"content-security-policy"]
    assert given[b"referrer-policy"] == b"no-referrer"
    assert asked(headers=(("host", f"localhost:{PORT}"),))[1]
    assert asked(headers=(HOST, ORIGIN), kind="websocket")[0]["type"] == "websocket.accept"


@pytest.mark.parametrize(
    "path", ["/", "", "/wrong/", f"/{TOKEN}", f"/{TOKEN[:-1]}/", f"/x/../{TOKEN}/", f"//{TOKEN}/", "/ü/"]
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_the_token_nothing_is_shown(path, kind):
    answer, reached = asked(path, (HOST, ORIGIN), kind)
    assert not reached
    assert answer.get("status", 403) == 403
    assert answer["type"] in {"http.response.start", "websocket.close"}


@pytest.mark.parametrize(
    "headers",
    [
        (("host", f"evil.example:{PORT}"),),  # DNS rebinding: the name of another site that leads here
        (("host", "127.0.0.1"),),
        (("host", f"127.0.0.1:{PORT}.evil.example"),),
        (),
        (HOST, HOST),
        (HOST, ("origin", "https://evil.example")),
        (HOST, ("origin", "null")),
        (HOST, ("origin", f"http://127.0.0.1:{PORT + 1}")),
        (HOST, ("origin", f"http://localhost:{PORT}")),
        (HOST, ORIGIN, ("origin", "https://evil.example")),
        (HOST, ("sec-fetch-site", "cross-site")),
        (HOST, ("sec-fetch-site", "same-site")),
    ],
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_other_hosts_origins_and_sites_are_refused(headers, kind):
    answer, reached = asked(headers=headers, kind=kind)
    assert not reached
    assert answer.get("status", 403) == 403


def test_a_web_socket_without_an_origin_is_refused():
    assert not asked(headers=(HOST,), kind="websocket")[1]


def test_uploads_are_bounded():
    assert asked(body=[b"x" * 500, b"x" * 500])[0]["status"] == 200
    answer, reached = asked(headers=(HOST, ("content-length", "1001")))
    assert (answer["status"], reached) == (413, False)
    assert asked(headers=(HOST, ("content-length", "-1")))[0]["status"] == 413
    assert asked(headers=(HOST, ("content-length", "9" * 400)))[0]["status"] == 413
    assert asked(body=[b"x" * 600, b"x" * 600])[0]["status"] == 413  # whose length was not said


@pytest.mark.parametrize(
    "name",
    ["../up.toml", "/etc/x.toml", "a/b.toml", "a\\b.toml", ".hidden.toml", "C:x.toml", "x", "", "x.toml ", "x\0.toml",
     "x\n.toml", "x" * 300 + ".toml", "~root.toml", "$HOME.toml"],
)  # fmt: skip
def test_a_name_that_leads_elsewhere_is_refused(refuses, name):
    refuses(file_in, "/folder", name, ".toml")


def test_usual_names_are_taken():
    assert file_in("/folder", "Ma machine (2).toml", ".toml") == "/folder/Ma machine (2).toml"
    assert file_in("/folder", "größe_c", "") == "/folder/größe_c"
