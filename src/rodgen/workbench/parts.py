"""Small parts of the page: headings, buttons, cards that are filled anew, messages."""

from __future__ import annotations

import html
import re
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager
from inspect import signature
from typing import Any

from nicegui import ui

from rodgen.document import Block, as_html
from rodgen.errors import RodgenError

STYLE = """
:root{--paper:#fff;--wash:#f6f7f9;--ink:#1b1f24;--soft:#57606a;--mid:#8c959f;--line:#dfe3e8}
.body--dark{--paper:#14171a;--wash:#1c2126;--ink:#e8eaed;--soft:#a9b3bd;--mid:#7d8690;--line:#2f363d}
body{background:var(--paper);color:var(--ink);font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.nicegui-content{padding:8px 12px;gap:8px}
.desk{display:grid;grid-template-columns:minmax(340px,400px) minmax(0,1fr);gap:16px;width:100%;align-items:start}
.side,.main{display:flex;flex-direction:column;gap:12px;min-width:0}
.card{border:1px solid var(--line);border-radius:6px;padding:8px 10px;width:100%;min-width:0}
h1{font-size:1.15rem;font-weight:650;line-height:1.3;letter-spacing:0;margin:0}
h2{font-size:1rem;font-weight:650;line-height:1.4;letter-spacing:0;margin:0}
.w-full{width:100%}
.head{display:flex;flex-wrap:wrap;gap:6px;align-items:center;width:100%}
.head h1{margin:0 auto 0 0}
.q-slider{margin-left:12px}
.soft{color:var(--soft);font-size:.85rem}
.legend{display:flex;flex-wrap:wrap;gap:2px 12px;font-size:.82rem}
.ladder{width:100%;border-collapse:collapse;font-size:.88rem}
.ladder th{font-weight:400;color:var(--soft);font-size:.85rem}
.ladder td,.ladder th{padding:1px 0 1px 10px;text-align:right;white-space:nowrap}
.ladder td:first-child,.ladder th:first-child{padding-left:0;text-align:left;white-space:normal;width:100%}
.line{display:flex;flex-wrap:wrap;gap:6px;align-items:center;width:100%}
.suspect{display:flex;gap:8px;align-items:flex-start;width:100%;padding:2px 0;border-top:1px solid var(--line)}
.suspect .what{flex:1;min-width:0}
.suspect.like{margin-left:18px;width:calc(100% - 18px)}
.q-tooltip{max-width:340px;font-size:.8rem}
.code{font-family:ui-monospace,monospace;font-size:.8rem;white-space:pre-wrap;background:var(--wash);padding:6px;width:100%}
.says{width:100%;overflow-x:auto;font-size:.88rem}
.says h3,.says h4{font-size:.95rem;font-weight:650;line-height:1.4;margin:.7rem 0 .2rem}
.says p,.says ul{margin:.3rem 0}.says ul{padding-left:1.1rem;list-style:disc}
.says table{border-collapse:collapse}
.says th,.says td{padding:1px 12px 1px 0;text-align:left;vertical-align:top;font-weight:400}
.says thead th,.says .facts th{color:var(--soft)}
.says .r,.says .b{text-align:right;white-space:nowrap}
.says pre{font-family:ui-monospace,monospace;font-size:.8rem;background:var(--wash);padding:6px}
.mono textarea{font-family:ui-monospace,monospace}
.plot{width:100%;overflow-x:auto;contain:paint}
.start{max-width:760px;width:100%;margin:0 auto;display:grid;gap:12px}
.start .card{display:flex;flex-direction:column;gap:8px;align-items:flex-start;padding:10px 12px}
.alert{color:#c04d00;position:sticky;top:0;z-index:2;background:var(--paper)}
.body--dark .alert{color:#f0a56b}
.wrong{border-color:#c04d00;border-width:2px}
.q-btn{text-transform:none}
@media(max-width:760px){.desk{display:flex;flex-direction:column;gap:8px}.side,.main{display:contents}
.head>:first-child{width:100%}.head{gap:4px}.head .q-btn{padding:2px 5px!important}.head .sign .block{font-size:0}
.head .sign .on-left{margin-right:0}
.first{order:-2}.second{order:-1}.last{order:1}.nicegui-content{padding:6px}}
"""


Handler = Callable[..., Awaitable[object]]


def shown_blocks(blocks: Iterable[Block]) -> None:
    """Show blocks of a document."""
    ui.html(as_html(blocks, 3), sanitize=False).classes("says")


def heading(text: str, level: int = 2) -> None:
    """Write a heading."""
    ui.html(f"<h{level}>{html.escape(text)}</h{level}>", sanitize=False)


def guarded(handler: Handler) -> Handler:
    """Return a handler that shows what cannot be done as a message; it takes an event where the other one does."""

    async def safe(*event: Any) -> None:
        try:
            await handler(*event)
        except (RodgenError, ValueError) as error:
            ui.notify(str(error), type="warning", multi_line=True, close_button="Close", timeout=0)

    async def with_event(event: Any) -> None:
        await safe(event)

    async def without() -> None:
        await safe()

    wanted = [p for p in signature(handler).parameters.values() if p.default is p.empty]
    return with_event if wanted else without


def button(
    text: str, handler: Handler, *, icon: str = "", tip: str = "", label: str = "", bare: bool = False
) -> ui.button:
    """Return a button; `label` is its name for a screen reader, where the text alone does not say it."""
    made = ui.button("" if bare else text, icon=icon or None, on_click=guarded(handler))
    made.props('outline dense no-caps padding="2px 8px"')
    made.props["aria-label"] = label or text
    if tip:
        made.tooltip(tip)
    return made


def card(title: str) -> ui.element:
    """Return an empty card."""
    made = ui.element("section").classes("card")
    made.props["aria-label"] = title
    return made


@contextmanager
def dialog(title: str, *, opened: bool = False) -> Iterator[ui.dialog]:
    """Fill a dialog, below its title."""
    made = ui.dialog(value=opened)
    made.props["aria-label"] = title
    with made, ui.card().style("width:560px;max-width:95vw"):
        heading(title)
        yield made


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
