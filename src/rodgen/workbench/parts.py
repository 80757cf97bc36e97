"""Small parts of the page: headings, buttons, cards that are filled anew, messages."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager
from inspect import signature
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from rodgen.document import Block, as_html
from rodgen.errors import RodgenError

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")


Handler = Callable[..., Awaitable[object]]


def shown_blocks(blocks: Iterable[Block]) -> None:
    """Show blocks of a document."""
    ui.html(as_html(blocks, 3), sanitize=False).classes("says")


def heading(text: str, level: int = 2) -> None:
    """Write a heading."""
    TextElement(tag=f"h{level}", text=text)


def soft(text: str) -> ui.label:
    """Write text that stands back."""
    return ui.label(text).classes("soft")


def cell(words: str, kind: str = "td") -> None:
    """Write a cell of a table."""
    TextElement(tag=kind, text=words)


@contextmanager
def folded(title: str, *, opened: bool = False) -> Iterator[None]:
    """Fill what is shown when its title is clicked."""
    with ui.element("details").classes("w-full") as details:
        if opened:
            details.props("open")
        TextElement(tag="summary", text=title)
        yield


def unfolding(title: str, fill: Callable[[], object], *, opened: bool = False) -> None:
    """Show a title; what `fill` makes is made when it is first clicked, or at once where it is `opened`."""
    with ui.element("details").classes("w-full") as place:
        TextElement(tag="summary", text=title)
        if opened:
            place.props("open")
            fill()
            return

    def unfold() -> None:
        if pending:
            pending.clear()
            with place:
                fill()

    pending = [True]
    place.on("toggle", unfold, args=[])


def waiting(words: str) -> None:
    """Say that something is being computed, in the place where it will be."""
    soft(words).props('role="status"')
    for width in (92, 76, 84):
        ui.element("div").classes("wait").style(f"width:{width}%").props('aria-hidden="true"')


def guarded(handler: Handler) -> Handler:
    """Return a handler that shows what cannot be done as a message; it takes an event where the other one does."""
    every = signature(handler).parameters.values()
    wanted = any(p.default is p.empty and p.kind is not p.VAR_POSITIONAL for p in every)

    async def safe(event: Any) -> None:
        try:
            await (handler(event) if wanted else handler())
        except (RodgenError, ValueError) as error:
            ui.notify(str(error), type="warning", multi_line=True, close_button="Close", timeout=0)

    return safe


def button(text: str, handler: Handler, *, icon: str = "", label: str = "", look: str = "plain") -> ui.button:
    """Return a button; `label` is its name for a screen reader, where the text alone does not say it.

    It looks "plain", or is "first": what a user most likely wants next, or "bare": its icon alone.
    """
    element = ui.button("" if "bare" in look else text, icon=icon or None, on_click=guarded(handler))
    element.props("unelevated no-caps" if look == "first" else "flat no-caps color=none").classes(look)
    element.props["aria-label"] = label or text
    return element


def card(title: str) -> ui.element:
    """Return an empty card."""
    section = ui.element("section").classes("card")
    section.props["aria-label"] = title
    return section


@contextmanager
def dialog(title: str, *, opened: bool = False) -> Iterator[ui.dialog]:
    """Fill a dialog, below its title."""
    element = ui.dialog(value=opened)
    element.props["aria-label"] = title
    if opened:
        element.on("hide", element.delete)
    with element, ui.card():
        with ui.element("div").classes("both w-full"):
            heading(title)
            ui.button(icon="close", on_click=element.close).props(
                "flat round dense color=none aria-label=Close"
            )
        yield element


def field(label: str, *, value: str = "", example: str = "", most: int = 2000, **events: Any) -> ui.input:
    """Return a field for text of `most` characters."""
    text_input = ui.input(label, value=value, placeholder=example, **events)
    return text_input.props(f"dense outlined maxlength={most}").classes("grow w-full")


@contextmanager
def anew(place: ui.element, title: str = "") -> Iterator[None]:
    """Fill a place anew, below a title; without one, below that of a card."""
    place.clear()
    with place:
        if title:
            heading(title)
        yield


def completing(field: ui.input, words: Callable[[], Iterable[str]]) -> None:
    """Let Tab complete the word that is typed in a field, of names and of what they are joined to by points."""

    def offer() -> None:
        text = str(field.value or "")
        begun = re.search(r"[^\W\d][\w.]*$", text)
        known = sorted(word for word in words() if begun and word.startswith(begun[0]) and word != begun[0])
        field.set_autocomplete([text[: begun.start()] + word for word in known] if begun else [])

    field.on_value_change(offer)


async def downloaded(text: str, name: str) -> None:
    """Let the browser save a text as a file."""
    ui.download.content(text, name)
