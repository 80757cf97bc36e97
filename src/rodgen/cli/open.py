"""``rodgen open``: the workbench, a page on which effects are added and the error falls."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from rodgen.cli._console import OK, Command, argument, flag, option, show
from rodgen.cli._machine import FILES
from rodgen.cli._values import InputFile, whole
from rodgen.errors import InputFileError
from rodgen.files import written_at_once

_OPEN = f"""\
Open a machine and its measurements on a page in the browser: see the residuals, suspect, add an effect, watch the error
fall, undo. Nothing leaves this computer: the page is at 127.0.0.1, under an address with a random token, until
Ctrl-C. A session that was saved (.rodgen) opens with everything that was done.

{FILES}
  rodgen open mount.toml stars.csv
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "open",
        _run,
        _OPEN,
        argument(
            "MACHINE", "the machine file, or a session; left out, examples and files", InputFile, nargs="?"
        ),
        argument("DATA", "the measurements; a session knows its own", InputFile, nargs="?"),
        flag("--no-browser", "print the address only"),
        option("--port N", "default: any that is free", whole(1, 65535), default=0),
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.workbench.desk import Desk
    from rodgen.workbench.server import serve
    from rodgen.workbench.session import ENDING, Session

    desks: list[Desk] = []
    left: list[Desk] = []
    if options.data is not None:
        desks.append(Desk(Session.open(options.machine, options.data)))
    elif options.machine is not None:
        if not options.machine.endswith(ENDING):
            expected = f"it, or a session that ends in {ENDING}"
            raise InputFileError("command line", "rodgen open", "no DATA", expected)
        desks.append(Desk(Session.load(options.machine)))

    def page() -> Callable[[], object]:
        from rodgen.cli.imports import imported_with
        from rodgen.workbench.page import Page
        from rodgen.workbench.start import Start

        def opened(session: Session) -> None:
            desks.append(next((desk for desk in left if desk.session is session), None) or Desk(session))

        def leave() -> None:
            left[:] = desks[-1:]
            desks.clear()

        return lambda: (
            Page(desks[-1], leave) if desks else Start(opened, imported_with, [desk.session for desk in left])
        )

    with written_at_once():  # what is saved on the page
        serve(
            page,
            port=options.port,
            browser=not options.no_browser,
            tell=lambda address: show(f"{address}\nCtrl-C ends it."),
        )
    return OK
