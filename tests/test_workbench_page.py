"""The page of the workbench, by NiceGUI's own harness: what a user clicks and reads."""

import asyncio
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui")
from nicegui import ElementFilter, events, ui
from nicegui.testing import user_simulation
from nicegui.testing.user_interaction import UserInteraction

from rodgen.calibration.plan import plan as make_plan
from rodgen.calibration.plan.constraints import constraints_of
from rodgen.workbench.actions import Add
from rodgen.workbench.desk import Desk
from rodgen.workbench.page import Page
from rodgen.workbench.session import Session

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"


@pytest.fixture
def files(tmp_path):
    for name in ("machine.toml", "mmt_2021.csv"):
        shutil.copy(MOUNT / name, tmp_path)
    return tmp_path / "machine.toml", tmp_path / "mmt_2021.csv"


class Walker:
    """A user in a window of a session."""

    def __init__(self, user, desk):
        self.user, self.desk = user, desk

    @property
    def session(self):
        return self.desk.session

    async def sees(self, text):
        await self.user.should_see(text, retries=100)

    async def until(self, condition):
        for _ in range(400):
            if condition():
                return
            await asyncio.sleep(0.05)
        raise AssertionError("it does not happen")

    def there(self, label, kind=ui.element):
        with self.user:
            found = [e for e in ElementFilter(kind=kind) if e.visible]
        return [e for e in found if label in (e.props.get("aria-label"), e.props.get("label"))]

    def named(self, label, kind=ui.element):
        found = self.there(label, kind)
        assert len(found) == 1, (label, found)
        return found[0]

    async def press(self, label):
        await self.until(lambda: self.there(label) and self.named(label, ui.button).enabled)
        button = self.named(label, ui.button)
        UserInteraction(user=self.user, elements={button}, target=None).click()

    async def does(self, label, at):
        """Press a button that leads to the state of a number."""
        await self.press(label)
        await self.until(lambda: self.session.at == at)

    def types(self, label, text):
        self.named(label).set_value(text)

    def scale(self):
        """Return against what the first plot is, and the ends of its lower y axis."""
        with self.user:
            layout = next(iter(ElementFilter(kind=ui.plotly))).props["options"]["layout"]
        return layout["xaxis2"]["title"]["text"], layout["yaxis2"]["range"]

    def brush(self, rows):
        """Drag over marks of the first plot."""
        with self.user:
            plot = next(iter(ElementFilter(kind=ui.plotly)))
        for listener in plot._event_listeners.values():
            if listener.type == "plotly_selected":
                events.handle_event(
                    listener.handler,
                    events.GenericEventArguments(sender=plot, client=plot.client, args={"rows": rows}),
                )


def walk(session, *walks):
    """Let users walk over the page of a session, one after the other, each in a window of its own."""

    async def run():
        desk = Desk(session)
        async with user_simulation(root=lambda: Page(desk, lambda: None)) as user:
            user.javascript_rules[re.compile(r".*innerWidth.*")] = lambda _: [1280, False]
            for each in walks:
                await user.open("/")
                await each(Walker(user, desk))

    asyncio.run(run())


@pytest.mark.thorough
def test_effects_are_added_taken_back_and_added_again(files):
    async def first(walker):
        await walker.sees("Error 2.71 arcsec per reading")
        await walker.until(lambda: walker.desk.suspects is not None)
        await walker.sees("very strong, more than a million to 1")
        await walker.sees("or 5 others, indistinguishable")
        before = walker.scale()
        await walker.does("Add tube_flexure (TF)", 1)
        await walker.sees("Error 0.969")
        assert walker.scale() == before  # the error is seen to fall
        await walker.until(lambda: walker.desk.suspects is not None)
        await walker.does("Add refraction (TX)", 2)
        await walker.sees("Error 0.659")
        await walker.sees(
            "refraction (TX) shows in these data: with it the readings are more than a million times more probable"
        )
        await walker.until(lambda: walker.desk.suspects is not None)
        await walker.sees("No effect of the catalogue explains more than chance does.")
        await walker.sees("Below this, chance explains as much")
        await walker.does("Undo", 1)
        await walker.sees("Error 0.969")
        await walker.does("Redo", 2)
        await walker.sees("Error 0.659")
        await walker.does("Remove tube_flexure (TF)", 3)
        await walker.sees("Error 1.89")
        await walker.does("Go back to: + refraction (TX)", 2)

    async def in_another_window(walker):
        await walker.sees("Error 0.659")
        assert len(walker.desk.windows) == 2

    walk(Session.open(*files), first, in_another_window)


@pytest.mark.slow
def test_a_window_that_is_gone_is_drawn_no_more(files):
    async def user(walker):
        await walker.sees("Error 2.71")
        (window,) = walker.desk.windows
        window.client.delete()  # as NiceGUI does to one that was asked for and never connected
        await walker.until(lambda: not walker.desk.windows)

    walk(Session.open(*files), user)


@pytest.mark.slow
def test_rows_are_brushed_away_and_back_and_what_was_done_is_kept(files):
    session, folder = Session.open(*files), files[0].parent

    async def user(walker):
        await walker.sees("Error 2.71")
        walker.brush([4, 5, 6.0, "x", None, 10**9])
        await walker.sees("3 rows selected")
        walker.types("Note", "clouds <script>alert(1)</script>")
        await walker.does("Exclude", 1)
        assert session.state.aside.sum() == 3
        await walker.sees("3 rows excluded")
        await walker.does("Include again", 2)
        assert not session.state.aside.any()
        walker.types("Rule", "EL > 80 deg")
        await walker.press("Select by the rule")
        high = int(np.sum(np.degrees(session.state.observations.q[:, 1]) > 80))
        await walker.sees(f"{high} rows selected")
        await walker.does("Exclude", 3)
        assert session.state.aside.sum() == high
        await walker.sees("EL > 80 deg excluded")
        assert '    { where = "EL > 80 deg" },\n' in session.state.text
        await walker.does("Include again", 4)
        assert session.state.text == session.states[0].text
        walker.types("Rule", "EL > many")
        await walker.press("Select by the rule")
        await walker.sees("expected a number, with its unit")
        walker.types("Session", "../up.rodgen")
        await walker.press("Write: Session")
        await walker.sees("a name without a folder")
        walker.types("Session", "kept.rodgen")
        await walker.press("Write: Session")
        await walker.sees("kept.rodgen is written.")
        walker.named("As").set_value("cpp")
        await walker.press("Write: Code, a folder")
        await walker.sees("machine_cpp is written.")
        walker.named("As").set_value("linuxcnc")
        await walker.press("Write: Code, a folder")
        await walker.sees("no chain that moves a point")
        await walker.does("Undo", 3)

    walk(session, user)
    assert not list(folder.parent.glob("*.rodgen"))
    assert [*(folder / "machine_cpp").glob("*.hpp")]
    assert not (folder / "machine_linuxcnc").exists()
    again = Session.load(folder / "kept.rodgen")
    assert (again.at, len(again.states)) == (3, 5)
    assert again.state.action.where == "EL > 80 deg"
    assert again.states[1].action.why.startswith("clouds <script>")


@pytest.mark.thorough
def test_a_formula_is_checked_where_it_is_typed(files):
    session = Session.open(*files)

    async def user(walker):
        walker.types("Formula", "2*A")
        assert walker.named("Formula").props["_autocomplete"] == ["2*AZ"]
        walker.types("Parameters and units", "k: arcs")
        assert walker.named("Parameters and units").props["_autocomplete"] == ["k: arcsec"]
        walker.types("Formula", "k*co")
        assert walker.named("Formula").props["_autocomplete"] == ["k*cos("]
        walker.named("At").set_value("EL")
        walker.types("Parameters and units", "k: arcsec")
        walker.types("Formula", "k*cos(q")
        await walker.until(lambda: walker.named("Formula").error)
        assert not walker.named("Add the formula").enabled
        walker.types("Formula", "k*cos(x)")
        await walker.until(lambda: "x" in walker.named("Formula").error)
        walker.types("Formula", "k*cos(q)" + " " * 10**6)
        await walker.sees("1000008 characters; expected 2000 at most")
        assert not walker.named("Add the formula").enabled
        walker.types("Formula", "k*cos(q)")
        await walker.until(lambda: not walker.named("Formula").error)
        await walker.does("Add the formula", 1)
        await walker.sees("Error 0.969")

    walk(session, user)


@pytest.mark.slow
def test_a_parameter_is_tied_to_another_and_untied(files):
    session = Session.open(*files)

    async def user(walker):
        await walker.press("Change EL.axis.a")
        await walker.until(lambda: walker.there("It"))
        walker.named("It").set_value("tied")
        walker.types("What", "EL.axis.a")
        await walker.press("Apply")
        await walker.sees("itself; expected parameters that are not tied")
        walker.types("What", "2 * AZ.axis.a")
        await walker.does("Apply", 1)
        await walker.sees("tied to 2 * AZ.axis.a")
        await walker.press("Change EL.axis.a")
        await walker.until(lambda: walker.there("It"))
        await walker.does("Apply", 2)
        await walker.does("Undo", 1)

    walk(session, user)
    assert session.state.machine.ties.keys() == {"EL.axis.a"}


@pytest.mark.slow
def test_a_wrong_sign_is_told_and_repaired_by_one_click(files):
    text = files[0].read_text()
    files[0].write_text(text.replace("axis = [0, 0, -1]", "axis = [0, 0, 1]"))
    session = Session.open(*files)

    async def user(walker):
        await walker.sees("The machine file or the measurements are wrong.")
        repair = next(m.words for m in session.state.check.repairs)
        await walker.does(f"Repair: {repair}", 1)
        await walker.sees("Error 2.71 arcsec")
        await walker.until(lambda: "check" in session.state.__dict__)
        assert not session.state.check.wrong

    walk(session, user)
    assert session.state.text == text


@pytest.mark.slow
def test_a_diagnosis_runs_in_the_background_and_its_steps_are_taken_or_left(files):
    session = Session.open(*files)

    async def user(walker):
        await walker.press("Diagnose")
        await walker.until(lambda: walker.desk.diagnosis is not None)
        await walker.sees("These are missing: tube_flexure")
        await walker.does("Take tube_flexure (TF)", 1)
        await walker.until(lambda: not walker.there("Take tube_flexure (TF)"))
        await walker.does("Undo", 0)
        await walker.until(lambda: walker.there("Take tube_flexure (TF)"))
        await walker.does("Take all", 2)
        await walker.sees("All that the diagnosis found is in the model.")
        await walker.sees("The error falls from 2.71 to 0.659 arcsec.")
        await walker.press("Diagnose")
        await walker.until(lambda: walker.desk.work is not None)
        walker.desk.work.stop()
        await walker.until(lambda: walker.desk.work is None)
        assert walker.desk.diagnosis[0] is session.states[0]

    walk(session, user)
    assert session.state.action.why == "diagnosis"


@pytest.mark.slow
def test_a_plan_within_constraints_is_marked_in_the_plots_and_discarded(files):
    session = Session.open(*files)

    async def user(walker):
        def marked():
            with walker.user:
                plots = [e.props["options"]["data"] for e in ElementFilter(kind=ui.plotly)]
            return [trace for data in plots for trace in data if trace.get("name") == "planned"]

        await walker.press("Plan")
        await walker.until(lambda: walker.there("Make the plan"))
        limits = walker.named("Constraints, or empty")
        walker.types("Constraints, or empty", "[limits]\nEL = [30, x]")
        await walker.until(lambda: limits.error)
        assert not walker.named("Make the plan").enabled
        walker.types("Constraints, or empty", "[limits]\nFL = [30, 60]")
        assert "FL: unknown key; expected one of AZ, EL" in limits.error
        walker.types("Constraints, or empty", "[limits]\nEL = [30, 60]")
        assert limits.error is None
        await walker.until(lambda: walker.desk.suspects is not None)
        walker.types("To sharpen, or empty", "AZ.axis.a, EL.enc")
        assert (
            "AZ.axis.a, EL.encoder_ellipticity" in walker.named("To sharpen, or empty").props["_autocomplete"]
        )
        walker.types("To sharpen, or empty", "AZ.axis.a")
        walker.types("Readings at most", 6)
        await walker.press("Make the plan")
        await walker.until(lambda: walker.desk.plan is not None and len(marked()) >= 2)
        _, plan, wish = walker.desk.plan
        limits = constraints_of(wish.constraints, "limits.toml", session.state.machine)
        assert make_plan(session.state.fit, 6, wanted=["AZ.axis.a"], constraints=limits).rows == plan.rows
        assert all(30 <= el <= 60 for el in plan.rows["EL [deg]"])
        await walker.press("Discard the plan")
        await walker.until(lambda: not marked())

    walk(session, user)


@pytest.mark.thorough
def test_undo_twice_at_once_takes_two_actions_back(files):
    session = Session.open(*files)
    for name in ("tube_flexure", "refraction"):
        session.do(Add({"name": name}))
    desk = Desk(session)

    async def twice():
        await asyncio.gather(desk.undo(), desk.undo())

    asyncio.run(twice())
    assert session.at == 0
