"""The page of the workbench, by NiceGUI's own harness, and who may ask its server."""

import asyncio
import shutil
from pathlib import Path

import pytest

nicegui = pytest.importorskip("nicegui")
from nicegui.testing import user_simulation  # noqa: E402

from rodgen.workbench.desk import Desk  # noqa: E402
from rodgen.workbench.page import Page  # noqa: E402
from rodgen.workbench.session import Session  # noqa: E402

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"


@pytest.fixture
def files(tmp_path):
    for name in ("machine.toml", "mmt_2021.csv"):
        shutil.copy(MOUNT / name, tmp_path)
    return tmp_path / "machine.toml", tmp_path / "mmt_2021.csv"


def walked(session, walk):
    """Let a user walk over the page of a session."""

    async def run():
        desk = Desk(session)
        async with user_simulation(root=lambda: Page(desk)) as user:
            user.javascript_rules[r".*innerWidth.*"] = None
            import re

            user.javascript_rules.clear()
            user.javascript_rules[re.compile(r".*innerWidth.*")] = lambda _: [1280, False]
            await user.open("/")
            return await walk(user, desk)

    return asyncio.run(run())


async def until(condition, seconds=20.0):
    for _ in range(int(seconds / 0.05)):
        if condition():
            return
        await asyncio.sleep(0.05)
    raise AssertionError("it does not happen")


def named(user, label):
    """Return the one element with a name for screen readers."""
    from nicegui import ElementFilter

    with user:
        found = [e for e in ElementFilter() if e.props.get("aria-label") == label and e.visible]
    assert len(found) == 1, (label, found)
    return found[0]


def press(user, label):
    from nicegui.testing.user_interaction import UserInteraction

    UserInteraction(user=user, elements={named(user, label)}, target=label).click()


def test_effects_are_added_taken_back_and_added_again(files):
    async def walk(user, desk):
        await user.should_see("Error 2.71 arcsec per reading")
        await until(lambda: desk.suspects is not None)
        press(user, "Add tube_flexure")
        await until(lambda: desk.session.at == 1)
        await user.should_see("Error 0.969")
        await until(lambda: desk.suspects is not None)
        press(user, "Add refraction")
        await until(lambda: desk.session.at == 2)
        await user.should_see("Error 0.659")
        await user.should_see("refraction explains more than chance does")
        await user.should_see("rodgen add")
        press(user, "Undo")
        await user.should_see("Error 0.969")
        press(user, "Redo")
        await user.should_see("Error 0.659")

    walked(Session.open(*files), walk)
