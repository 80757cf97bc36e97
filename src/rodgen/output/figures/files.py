"""Write figures into files: a page that works everywhere, and images through Kaleido, which needs Chrome or Chromium.

The same figure gives the same bytes: what a browser puts into a file by chance or by the clock is taken out.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from rodgen.errors import InputFileError
from rodgen.files import OutputSet, make_folder, write_file

if TYPE_CHECKING:
    import plotly.graph_objects as go

PAGES = (".html", ".htm")
IMAGES = ("png", "svg", "pdf")
_TRIAL = "'{} --headless --no-sandbox --dump-dom about:blank'"
"""A command that shows what a browser lacks."""
SCALE = 2.0
"""Pixels of a PNG for each pixel of the figure."""


def save_figure(figure: go.Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure into a file.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        Made by a function of `rodgen.figures`.
    path : str or os.PathLike
        Ends in ``.html``, or in ``.png``, ``.svg`` or ``.pdf``, which need Chrome or Chromium.

    Raises
    ------
    InputFileError
        When the name has another ending, the file cannot be written, or there is no browser that draws an image.
    """
    kind = check_figure_name(path)
    if kind == "html":
        from rodgen.output.figures.html import figure_page

        write_file(path, figure_page([figure]).encode())
    else:
        (content,) = _images([(figure, kind)], os.fspath(path))
        write_file(path, content)


def save_figures(
    figures: Iterable[go.Figure],
    path: str | os.PathLike[str],
) -> list[str]:
    """Write figures onto one page, or as images into a folder.

    Parameters
    ----------
    figures : iterable of plotly.graph_objects.Figure
    path : str or os.PathLike
        A name that ends in ``.html``: one page with all figures. Any other: a folder, made where it is not there, for
        each figure as PNG and as SVG, which need Chrome or Chromium.

    Returns
    -------
    list of str
        The files.

    Raises
    ------
    InputFileError
        When a file cannot be written, or there is no browser that draws images.
    """
    place = os.fspath(path)
    listed = list(figures)
    if place.lower().endswith(PAGES):
        from rodgen.output.figures.html import figure_page

        write_file(place, figure_page(listed).encode())
        return [place]
    jobs = [(figure, kind) for figure in listed for kind in ("png", "svg")]
    files = [os.path.join(place, f"{figure.layout.meta['name']}.{kind}") for figure, kind in jobs]
    with OutputSet():
        make_folder(place)
        for file, content in zip(files, _images(jobs, place), strict=True):
            write_file(file, content)
    return files


def check_figure_name(path: str | os.PathLike[str]) -> str:
    """Return the kind of file that a name asks for: ``"html"``, ``"png"``, ``"svg"`` or ``"pdf"``.

    Raises
    ------
    InputFileError
        When it asks for none, or for an image where there is no browser that can draw it.
    """
    file = os.fspath(path)
    if file.lower().endswith(PAGES):
        import plotly  # noqa: F401 - that it is missing is said at once

        return "html"
    kind = os.path.splitext(file)[1].lower()[1:]
    if kind not in IMAGES:
        raise InputFileError(
            file,
            "file",
            "a name that does not say what to draw",
            "a name that ends in .html, .png, .svg or .pdf",
        )
    check_images(file)
    return kind


def check_place(path: str | os.PathLike[str]) -> None:
    """Find out whether `save_figures` can draw into a place, before the work that leads to the figures.

    Raises
    ------
    InputFileError
        When it is a folder for images and there is neither Chrome nor Chromium.
    """
    if not os.fspath(path).lower().endswith(PAGES):
        check_images(path)


def check_images(path: str | os.PathLike[str]) -> None:
    """Find out whether images can be drawn, before the work that leads to them.

    Raises
    ------
    InputFileError
        When there is neither Chrome nor Chromium.
    """
    import kaleido  # noqa: F401 - that it is missing is said at once

    if browser() is None:
        raise _no_browser(path)


def browser() -> str | None:
    """Return the path of the Chrome or Chromium that draws images, or None where there is neither."""
    from choreographer.browsers.chromium import Chromium

    path = Chromium.find_browser(skip_local=False)
    return str(path) if path else None


def _no_browser(path: str | os.PathLike[str]) -> InputFileError:
    return InputFileError(
        os.fspath(path),
        "file",
        "no Chrome or Chromium, which images are drawn with",
        "one of them to be installed, or a name that ends in .html, which needs none",
    )


def _images(jobs: list[tuple[go.Figure, str]], path: str) -> list[bytes]:
    """Return figures as images, drawn by one browser."""
    import kaleido
    from choreographer.errors import (
        BrowserClosedError,
        BrowserFailedError,
        ChannelClosedError,
        ChromeNotFoundError,
    )

    async def draw() -> list[bytes]:
        # No MathJax: it would be asked of the network, and text is drawn as it is.
        async with kaleido.Kaleido(n=1, mathjax=False) as browser:
            return [
                await browser.calc_fig(
                    _named_traces(figure),
                    opts={
                        "format": kind,
                        "width": figure.layout.width,
                        "height": figure.layout.height,
                        "scale": SCALE if kind == "png" else 1,
                    },
                )
                for figure, kind in jobs
            ]

    try:
        # A notebook has a running event loop, and a thread can run one only.
        with ThreadPoolExecutor(1) as thread:
            drawn = thread.submit(asyncio.run, draw()).result()
    except ChromeNotFoundError:
        raise _no_browser(path) from None
    except (BrowserFailedError, BrowserClosedError, ChannelClosedError):
        # It is started without its sandbox and shared memory, which containers lack: something else is missing.
        found = f"{browser()}, which images are drawn with, ends when it is started"
        trial = _TRIAL.format(browser())
        expected = f"one with which {trial} works, or a name that ends in .html, which needs no browser"
        raise InputFileError(path, "file", found, expected) from None
    return [_fixed(content, kind) for content, (_, kind) in zip(drawn, jobs, strict=True)]


def _named_traces(figure: go.Figure) -> dict[str, Any]:
    """Return a figure as data whose traces have names of their own: plotly.js would make up random ones."""
    content: dict[str, Any] = figure.to_dict()
    for number, trace in enumerate(content["data"]):
        trace["uid"] = f"t{number:05d}"
    return content


def _fixed(content: bytes, kind: str) -> bytes:
    """Return an image without what differs from one drawing to the next."""
    if kind == "svg":
        # plotly.js names its clip paths and gradients by six random digits
        match = re.search(rb'id="(?:clip|topdefs-|defs-)([0-9a-f]{6})', content)
        if match:
            content = content.replace(match[1], b"rodgen")
    if kind == "pdf":
        content = re.sub(rb"D:\d{14}", b"D:20000101000000", content)
    return content
