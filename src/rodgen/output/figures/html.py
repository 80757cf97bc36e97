"""The page: a document with figures that needs no network, with plotly.js once, and the data of every figure.

A page runs nothing but the scripts that are put into it here: its content security policy names them by their hashes.
"""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Iterable
from importlib import resources
from importlib.metadata import version

import plotly.graph_objects as go
import plotly.io as pio
from plotly.offline import get_plotlyjs

from rodgen.document import Document, Figure, as_html
from rodgen.output.figures.style import DARK

PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<meta name="generator" content="rodgen {version}">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
<noscript><p class="note">Figures need JavaScript, which is off here; the tables hold the numbers.</p></noscript>
{head}<main>
{body}
</main>
<footer>Made by rodgen {version}. This file works offline.</footer>
<script type="application/json" id="figures">{figures}</script>
{scripts}
</body>
</html>
"""


def figure_page(figures: Iterable[go.Figure]) -> str:
    """Return a page that shows figures below each other, with the title of the first.

    Parameters
    ----------
    figures : iterable of plotly.graph_objects.Figure
        Made by the functions of `rodgen.figures`.
    """
    listed = list(figures)
    places = [figure_block(number, figure) for number, figure in enumerate(listed)]
    return page(Document(places, listed[0].layout.meta["title"]), listed)


def page(
    document: Document, figures: Iterable[go.Figure], *, over: str = "", more: str = "", window: str = ""
) -> str:
    """Return a document as a page that needs no network.

    Parameters
    ----------
    document : Document
    figures : iterable of plotly.graph_objects.Figure
        In the order of the numbers that their places have.
    over : str, optional
        A word above the title; without one the title is only that of the window.
    more : str, optional
        Text below the title.
    window : str, optional
        What the title of the window begins with; left out: the word above the title.
    """
    title, code = html.escape(document.title), (get_plotlyjs(), asset("figures.js"), asset("page.js"))
    soft = f'<p class="soft">{html.escape(more)}</p>' if more else ""
    head = (
        f'<header>\n<p class="over">{html.escape(over)}</p>\n<h1>{title}</h1>\n{soft}</header>\n'
        if over
        else ""
    )
    return PAGE.format(
        policy=policy(*code),
        version=version("rodgen"),
        title=f"{html.escape(window or over)}: {title}" if over else title,
        style=asset("page.css"),
        head=head,
        body=as_html(document.blocks),
        figures=figures_json(figures),
        scripts="\n".join(f"<script>{text}</script>" for text in code),
    )


def figure_block(number: int, figure: go.Figure) -> Figure:
    """Return the place of a figure on a page."""
    meta = figure.layout.meta
    return Figure(number, meta["name"], meta["title"], meta["note"], meta["alt"])


def figures_json(figures: Iterable[go.Figure]) -> str:
    """Return the data of figures and the colours of a dark page, as JSON that can be in a script element.

    What is drawn at an element is the figure whose number, from 0, its attribute ``data-figure`` has.
    """
    entries = ",".join(pio.to_json(figure, engine="json") for figure in figures)
    dark = ",".join(f'"{light}":"{dark}"' for light, dark in DARK.items())
    return f'{{"dark":{{{dark}}},"figures":[{entries}]}}'.replace("<", "\\u003c")


def policy(*code: str) -> str:
    """Return a content security policy that lets these scripts run, and nothing be asked of any network.

    Styles are let in as they are, because plotly.js writes style attributes; none of them can load anything.
    """
    allowed = " ".join(f"'{_hash(text)}'" for text in code)
    return (
        "default-src 'none'; img-src data: blob:; base-uri 'none'; form-action 'none'; "
        f"style-src 'unsafe-inline'; script-src {allowed}"
    )


def _hash(text: str) -> str:
    # a browser reads every line end as a line feed before it computes the hash
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def asset(name: str) -> str:
    """Return a file of this folder as text."""
    return resources.files(__package__ or "").joinpath(name).read_text(encoding="utf-8").strip()
