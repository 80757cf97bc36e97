"""Figures on a page that needs no network: plotly.js once, the data of every figure, and what draws them.

A page runs nothing but the scripts that are put into it here: its content security policy names them by their hashes.
"""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Iterable
from importlib import resources

import plotly.graph_objects as go
import plotly.io as pio
from plotly.offline import get_plotlyjs

from rodgen.output.figures.style import DARK

PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
<main>
{body}
</main>
<script type="application/json" id="figures">{figures}</script>
{scripts}
</body>
</html>
"""
FIGURE = """\
<figure>
<figcaption>{title}</figcaption>
{note}<div class="plot" data-figure="{number}" role="img" aria-label="{alt}"></div>
</figure>"""


def figure_page(figures: Iterable[go.Figure]) -> str:
    """Return a page that shows figures below each other, with the title of the first.

    Parameters
    ----------
    figures : iterable of plotly.graph_objects.Figure
        Made by the functions of `rodgen.figures`.
    """
    listed = list(figures)
    style = asset("figures.css")
    body = []
    for number, figure in enumerate(listed):
        title_of_figure, note, alt = (
            html.escape(figure.layout.meta[key]) for key in ("title", "note", "alt")
        )
        note = f'<p class="note">{note}</p>\n' if note else ""
        body.append(FIGURE.format(number=number, title=title_of_figure, note=note, alt=alt))
    code = scripts()
    return PAGE.format(
        policy=policy(*code),
        title=html.escape(listed[0].layout.meta["title"]),
        style=style,
        body="\n".join(body),
        figures=figures_json(listed),
        scripts="\n".join(f"<script>{text}</script>" for text in code),
    )


def figures_json(figures: Iterable[go.Figure]) -> str:
    """Return the data of figures and the colours of a dark page, as JSON that can stand in a script element.

    What is drawn at an element is the figure whose number, from 0, its attribute ``data-figure`` has.
    """
    entries = ",".join(pio.to_json(figure, engine="json") for figure in figures)
    dark = ",".join(f'"{light}":"{dark}"' for light, dark in DARK.items())
    return f'{{"dark":{{{dark}}},"figures":[{entries}]}}'.replace("<", "\\u003c")


def scripts() -> tuple[str, str]:
    """Return what a page with figures runs: plotly.js, and what draws each figure at its place."""
    return get_plotlyjs(), asset("figures.js")


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


def asset(name: str, package: str = __package__ or "") -> str:
    """Return a file of this folder, or of another package, as text."""
    return resources.files(package).joinpath(name).read_text(encoding="utf-8").strip()
