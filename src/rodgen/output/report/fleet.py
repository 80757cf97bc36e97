"""What a page says of a fleet, as tables and figures, and the page as one file that asks for nothing from outside."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from rodgen.calibration.fleet.summary import (
    VERDICTS,
    about_alarms,
    about_effect,
    about_machines,
    by_machine,
    parameter_cells,
    valued,
)
from rodgen.calibration.words import capitalized, sized
from rodgen.files import OutputSet, write_file
from rodgen.output.figures import fleet_nights, fleet_parameter, save_figures
from rodgen.output.figures.html import asset, figures_json, policy, scripts
from rodgen.output.report.page import environment, report_asset
from rodgen.statistics.thresholds import FLEET

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rodgen.calibration.fleet import Fleet
    from rodgen.calibration.fleet.fleet import FleetParameter, Kind

DRAWN, NIGHTS = 8, 6
"""Parameters that are drawn of each kind of machine, and changes."""
COLUMNS = 4
"""Parameters that each machine is listed with."""


@dataclass(frozen=True)
class FleetTable:
    """A table about a fleet."""

    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def fleet_tables(fleet: Fleet) -> Iterator[FleetTable]:
    """Yield the tables about all machines together."""
    if fleet.failed:
        rows = tuple((machine.name, machine.error) for machine in fleet.failed)
        yield FleetTable("Not diagnosed", "", ("machine", "why"), rows)
    if len(fleet.changes.nights) > 1:
        rows = tuple(by_machine(fleet.changes.found))
        yield FleetTable("Alarms", about_alarms(fleet), ("machine", "what changed"), rows)
    like = f"Of these {FLEET.false_discoveries:.0%} may be like the others."
    yield FleetTable("Odd machines", like, ("machine", "what is odd"), tuple(by_machine(fleet.odd)))
    for kind in fleet.kinds:
        yield _effects(kind)


def machine_tables(fleet: Fleet) -> Iterator[FleetTable]:
    """Yield the tables that list every machine, by kind."""
    yield from map(_machines, fleet.kinds)


def _effects(kind: Kind) -> FleetTable:
    rows = []
    for effect in kind.effects:
        head = (
            effect.title + about_effect(effect, ", "),
            f"{effect.found} of {effect.of}",
            f"{effect.alike}",
        )
        for parameter in effect.parameters or (None,):
            cells = ("", "–", "–", "–")
            if parameter is not None:
                cells = parameter.key.rpartition(".")[2], *parameter_cells(parameter)
            rows.append((*head, *cells))
            head = ("", "", "")
    note = (
        f"{len(kind.machines)} machines. Spread is that of the machines themselves, with its 95 % interval."
    )
    header = (
        "effect",
        "found in",
        "may be in",
        "parameter",
        "mean",
        "spread between machines",
        "one machine ±",
    )
    return FleetTable(f"Effects of {kind.title}", note, header, tuple(rows))


def _machines(kind: Kind) -> FleetTable:
    shown = drawn_parameters(kind)[:COLUMNS]
    places = [{name: i for i, name in enumerate(p.machines)} for p in shown]
    rows = []
    for machine in kind.machines:
        rms = machine.result["rms"]
        cells = [machine.name, VERDICTS[str(machine.result["verdict"])], ", ".join(machine.found) or "–"]
        cells.append("–" if rms["after"] is None else sized(float(rms["after"]), str(rms["unit"])))
        for p, place in zip(shown, places, strict=True):
            i = place.get(machine.name)
            pairs = ((p.values, p.std), (p.population.shrunk, p.population.shrunk_std))
            cells += ["–" if i is None else valued(float(x[i]), float(u[i]), p.unit) for x, u in pairs]
        rows.append(tuple(cells))
    header = ["machine", "verdict", "effects", "error left"]
    header += [words for p in shown for words in (f"{p.key} alone", "given the others")]
    note = "What is known of a machine given the others is nearer to the truth on average than what it shows alone."
    return FleetTable(capitalized(kind.title), note if shown else "", tuple(header), tuple(rows))


def drawn_parameters(kind: Kind) -> list[FleetParameter]:
    """Return the parameters of the commonest effects, which are drawn."""
    return [p for effect in kind.effects for p in effect.parameters][:DRAWN]


def fleet_figures(fleet: Fleet) -> list[go.Figure]:
    """Return the figures of a page about a fleet."""
    surest = {change.machine: change for change in reversed(fleet.changes.found)}  # one of each machine
    drawn = sorted(surest.values(), key=lambda change: change.p_value)[:NIGHTS]
    figures = [fleet_nights(fleet.changes, change) for change in drawn]
    return figures + [fleet_parameter(p) for kind in fleet.kinds for p in drawn_parameters(kind)]


def write_fleet_report(
    fleet: Fleet, path: str | os.PathLike[str], *, images: str | os.PathLike[str] | None = None
) -> list[str]:
    """Write what is known of a fleet as one HTML file that needs no network.

    Parameters
    ----------
    fleet : rodgen.calibration.fleet.Fleet
    path : str or os.PathLike
    images : str or os.PathLike, optional
        A folder for its figures, each as PNG and as SVG, which need Chrome or Chromium.

    Returns
    -------
    list of str
        The files that were written, the page first.

    Raises
    ------
    InputFileError
        When one of them cannot be written, or there is no browser for images.
    """
    figures, code = fleet_figures(fleet), scripts()
    page = (
        environment()
        .get_template("fleet.html.j2")
        .render(
            title=f"Fleet, {fleet.plan.date}",
            sentence=about_machines(fleet),
            tables=[*fleet_tables(fleet)],
            machines=[*machine_tables(fleet)],
            figures=[{"number": number, **figure.layout.meta} for number, figure in enumerate(figures)],
            drawn=Markup(figures_json(figures)),
            style=Markup(asset("figures.css") + "\n" + report_asset("report.css")),
            scripts=[Markup(text) for text in code],
            policy=policy(*code),
        )
    )
    with OutputSet():
        write_file(path, page.encode())
        return [os.fspath(path), *(save_figures(figures, images) if images is not None else [])]
