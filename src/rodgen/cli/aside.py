"""``rodgen set-aside`` and ``rodgen bring-back``: rows of measurements that do not count, in the machine file."""

from __future__ import annotations

import argparse

from rodgen.cli._change import add_output, new_name
from rodgen.cli._console import OK, Command, refused, show_result
from rodgen.cli._machine import FILES, add_files, add_json, load_data
from rodgen.files import write_file

_ASIDE = f"""\
Copy a machine file and note in it rows of measurements that are set aside: every command leaves them out, and says so.
DATA is not changed, and may grow; where the lines hold other measurements than now, it is an error. Which rows, and
why, is under set_aside in [measured]; the rest of the file is unchanged.

{FILES}
  rodgen set-aside mount.toml stars.csv --rows 12,40-43 --why clouds -o mount.toml
  rodgen set-aside mount.toml stars.csv --where "EL < 20 deg and load > 50 N"
"""

_BACK = f"""\
Copy a machine file and let rows of measurements count again that it sets aside: some, those of a run or a rule, or all.

{FILES}
  rodgen bring-back mount.toml stars.csv --rows 41 -o mount.toml
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    aside = command("set-aside", _set_aside, "set rows of measurements aside", _ASIDE)
    back = command("bring-back", _bring_back, "let rows that are set aside count again", _BACK)
    for each in (aside, back):
        add_files(each)
        which = each.add_mutually_exclusive_group(required=True)
        which.add_argument(
            "--rows",
            metavar="N,N-N",
            default="",
            help="lines of a CSV file from 1, else rows from 0, such as 12,40-43",
        )
        which.add_argument(
            "--run", metavar="NAME", dest="of_run", default="", help="a run, as the column run names it"
        )
        which.add_argument(
            "--where",
            metavar="RULE",
            default="",
            help="rows in which a column is <, <=, >, >=, = or != a value: 'EL < 20 deg'; several are joined by 'and'",
        )
        if each is back:
            which.add_argument("--all", action="store_true", help="all rows of DATA")
        each.add_argument("--why", metavar="TEXT", default="", help="a note")
        add_output(each)
        add_json(each)


def _set_aside(options: argparse.Namespace) -> int:
    return _change(options, "setting_aside", "set_aside")


def _bring_back(options: argparse.Namespace) -> int:
    return _change(options, "bringing_back", "brought_back")


def _change(options: argparse.Namespace, method: str, word: str) -> int:
    from rodgen.errors import InputFileError
    from rodgen.machines.files.edit import text_with_set_aside
    from rodgen.machines.machine import Machine

    machine, data = Machine.load(options.machine), load_data(options.data)
    which = {"rows": options.rows, "run": options.of_run, "where": options.where, "why": options.why}
    try:
        changed: Machine = getattr(machine, method)(data, **which)
    except InputFileError as error:
        if error.place != "[measured], set_aside":
            raise
        option = next((name for name in ("rows", "run", "where") if which[name]), "all")
        raise refused(f"--{option}", error.found, error.expected) from None
    text = text_with_set_aside(options.machine, changed.measured.set_aside)
    output = options.output or new_name(options.machine, (word,))
    write_file(output, text.encode())
    aside = changed.aside(data)
    said = aside.text if aside else f"No row of {options.data} is set aside."
    found = {"file": output, "set_aside": aside.to_dict() if aside else {"rows": 0, "entries": []}}
    show_result(options, lambda: found, lambda: f"{output}: {said}")
    return OK
