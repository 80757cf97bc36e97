"""The page of ``rodgen open`` alone: what is made of files that are dropped, and of templates."""

import asyncio
import gzip
import pickle
import tempfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui")
from nicegui import ElementFilter, ui
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from rodgen.cli.imports import imported_with
from rodgen.errors import MissingOptionError
from rodgen.machines.imports.imported import Imported
from rodgen.workbench.start import Start, opened

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"
MACHINE, STARS = ((MOUNT / name).read_bytes() for name in ("machine.toml", "mmt_2021.csv"))
URDF = b"""<robot name="arm"><link name="base"/><link name="arm"/><link name="tool"/>
<joint name="J1" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="J2" type="revolute"><parent link="arm"/><child link="tool"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>"""
FORK = b"""<link name="probe"/>
<joint name="J3" type="fixed"><parent link="arm"/><child link="probe"/></joint></robot>"""


@pytest.fixture(autouse=True)
def folders(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_machine_file_and_its_measurements_are_opened(folders):
    session = opened({"machine.toml": MACHINE, "stars.csv.gz": gzip.compress(STARS)}, (), imported_with)
    assert session.state.fit.rms == pytest.approx(2.71, abs=0.005)
    assert session.remarks == []
    assert sorted(path.name for path in folders.rglob("*.*")) == ["machine.toml", "stars.csv.gz"]


def test_columns_of_other_names_are_imported(refuses, folders):
    strange = STARS.replace(b"AZ [deg]", b"Rotation [deg]", 1)
    files = {"machine.toml": MACHINE, "stars.csv": strange}
    refuses(opened, files, (), imported_with)
    assert not [*folders.iterdir()]  # nothing is left of it
    session = opened(files, ["--column=AZ=Rotation"], imported_with)
    assert session.state.fit.rms == pytest.approx(2.71, abs=0.005)
    assert session.state.text == MACHINE.decode()
    refuses(
        opened, {"m.toml": MACHINE, "stars.csv": STARS.replace(b"347.2778909", b"x", 1)}, (), imported_with
    )


def test_a_robot_waits_for_its_readings(refuses, folders):
    made = opened({"arm.urdf": URDF}, (), imported_with)
    assert isinstance(made, Imported)
    assert [joint.name for joint in made.machine.joints] == ["J1", "J2"]
    turn = np.random.default_rng(1).uniform(-1.5, 1.5, (30, 2))
    x, y = 0.3 * np.cos(turn[:, 0]), 0.3 * np.sin(turn[:, 0])
    rows = np.column_stack([turn, x, y, np.full(30, 0.4)])
    table = "J1,J2,x,y,z\n" + "\n".join(",".join(map("{:.9f}".format, row)) for row in rows)
    session = opened({"arm.urdf": URDF, "run.csv": table.encode()}, (), imported_with)
    assert session.state.fit.rms < 1e-3
    assert any("Columns without a unit are in m and rad" in remark for remark in session.remarks)
    refuses(opened, {"arm.urdf": URDF}, ["--tip=elbow"], imported_with)
    for options in (["--help"], ["-o", "m.toml"], ["--plot=a.svg"], ["x.urdf"], ["--", "x.urdf"]):
        refuses(opened, {"arm.urdf": URDF}, options, imported_with)


def test_what_files_leave_open_is_asked_with_what_it_may_be(folders):
    strange = STARS.replace(b"AZ [deg]", b"Rotation [deg]", 1)
    with pytest.raises(MissingOptionError) as error:
        opened({"machine.toml": MACHINE, "stars.csv": strange}, (), imported_with)
    assert (error.value.file, error.value.option) == ("stars.csv", "--column=AZ=")
    assert "Rotation [deg]" in error.value.choices
    again = pickle.loads(pickle.dumps(error.value))
    assert (str(again), again.choices) == (str(error.value), error.value.choices)
    with pytest.raises(MissingOptionError) as error:
        opened({"arm.urdf": URDF.replace(b"</robot>", FORK)}, (), imported_with)
    assert (error.value.option, error.value.choices) == ("--tip=", ("tool", "probe"))


@pytest.mark.thorough
def test_the_one_missing_column_is_chosen_on_the_page():
    sessions = []

    async def run():
        async with user_simulation(root=lambda: Start(sessions.append, imported_with)) as user:
            await user.open("/")
            with user:
                (upload,) = ElementFilter(kind=ui.upload)
            strange = STARS.replace(b"AZ [deg]", b"Rotation [deg]", 1)
            files = ("machine.toml", MACHINE), ("stars.csv", strange)
            await upload.handle_uploads([SmallFileUpload(name, "", content) for name, content in files])
            await user.should_see("One thing is missing", retries=100)
            with user:
                (choice,) = [e for e in ElementFilter(kind=ui.select) if "column AZ" in e.props["label"]]
                choice.set_value("Rotation [deg]")
            user.find("Go on").click()
            for _ in range(400):
                await asyncio.sleep(0.02)
                if sessions:
                    break

    asyncio.run(run())
    assert sessions[0].state.fit.rms == pytest.approx(2.71, abs=0.005)


@pytest.mark.parametrize("content", [b"<script>alert(1)</script>", b"", b"\xff\xfe\x00", STARS])
def test_a_file_that_is_no_machine_is_one_sentence(refuses, content, folders):
    for name in ("x.toml", "x.csv", "x"):
        refuses(opened, {name: content}, (), imported_with)
    assert not [*folders.iterdir()]


@pytest.mark.thorough
def test_a_template_is_changed_and_opened_with_measurements():
    sessions = []

    async def run():
        async with user_simulation(root=lambda: Start(sessions.append, imported_with)) as user:
            await user.open("/")

            def named(label, kind=ui.element):
                with user:
                    found = [e for e in ElementFilter(kind=kind) if e.visible]
                (one,) = [e for e in found if label in (e.props.get("aria-label"), e.props.get("label"))]
                return one

            async def until(condition):
                for _ in range(400):
                    if condition():
                        return
                    await asyncio.sleep(0.02)
                raise AssertionError("it does not happen")

            def press(label):
                UserInteraction(user=user, elements={named(label, ui.button)}, target=None).click()

            named("Kind").set_value("alt-azimuth")
            press("Begin with the machine file")
            await user.should_see("Machine file alt-azimuth.toml")
            text = named("Machine file alt-azimuth.toml")
            text.set_value(text.value.replace("axis", "axes", 1))
            await user.should_see("alt-azimuth.toml: joint")
            text.set_value(MACHINE.decode())
            await user.should_see("Alt-azimuth mount of a telescope")
            with user:
                (upload,) = ElementFilter(kind=ui.upload)
            await upload.handle_uploads([SmallFileUpload("../stars <b>.csv", "text/csv", STARS)])
            await until(lambda: sessions)

    asyncio.run(run())
    assert sessions[0].state.fit.rms == pytest.approx(2.71, abs=0.005)
    assert Path(sessions[0].data_file).name == "stars _b_.csv"
