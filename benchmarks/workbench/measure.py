"""Time the page of `rodgen open` in Chromium: from the command to the first view, and from clicks to plots redrawn.

Every time ends when the browser has painted the last drawing of a plot that follows. The processor time of the server
and of the browser is that until then, as far as it can be asked at that moment; what comes later is not in it.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.browser import Browser, Window, browser, used
from workbench.cases import CASES

REPEATS = 3
QUIET = 1.5
"""Seconds without a drawing after which the last one was the last."""
PLOTS = 2
"""That are seen."""
WATCH = """(() => {
  const plots = new Map(), drawn = window.drawn = [];
  const painted = (plot) => requestAnimationFrame(() => setTimeout(() =>
    drawn.push({plot: plots.get(plot), at: performance.timeOrigin + performance.now()})));
  new MutationObserver(() => {
    for (const plot of document.querySelectorAll('.js-plotly-plot'))
      if (!plots.has(plot) && plot.on) {
        plots.set(plot, plots.size);
        plot.on('plotly_afterplot', () => painted(plot));
      }
  }).observe(document, {childList: true, subtree: true});
  for (const name of ['click', 'pointerup'])
    window.addEventListener(name, (e) => { window.began = performance.timeOrigin + e.timeStamp; }, true);
})()"""
"""Notes when each plot has been painted, and when the last click or release of the mouse was."""


def measure(*, quick: bool) -> dict[str, Any]:
    """Return the times of every case."""
    started = time.perf_counter()
    found = {}
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        for number, (name, case) in enumerate(CASES.items()):
            if quick and case.rows > 1_000:
                continue
            home = Path(folder) / str(number)
            home.mkdir()
            files = case.write(home)
            found[name] = _case(chromium, files, case.covariate, home / "cache", 1 if quick else REPEATS)
            said = ", ".join(f"{what} {item['wall']:.2f} s" for what, item in found[name].items())
            print(f"  {name}: {said}", flush=True)
        version = chromium.version
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    seconds = round(time.perf_counter() - started)
    return {"cases": found, "browser": version, "load after the run": load, "seconds": seconds}


def _case(
    chromium: Browser, files: list[Path], covariate: str, cache: Path, repeats: int
) -> dict[str, dict[str, float]]:
    """Return medians; the first of the first views makes the kernels and keeps them in the cache."""
    found: dict[str, list[dict[str, float]]] = {}
    for number in range(repeats + 1):
        with _opened(chromium, files, cache) as page:
            name = "first view" if number else "first view, nothing in the cache"
            found.setdefault(name, []).append(page.first)
            for _ in range(repeats if number == repeats else 0):
                for name, sample in _round(page, covariate):
                    found.setdefault(name, []).append(sample)
    return {
        name: {key: statistics.median(sample[key] for sample in samples) for key in samples[0]}
        for name, samples in found.items()
    }


@dataclass
class _Page:
    """A window on a server of its own.

    Attributes
    ----------
    window : Window
    server : int
        Number of its process.
    first : dict
        Times of the first view.
    """

    window: Window
    server: int
    first: dict[str, float]

    def timed(self, does: Callable[[], object], plots: int = PLOTS) -> dict[str, float]:
        """Return the times from a click until so many plots are drawn again, and none is any more."""
        self.rest()
        self.window.value("window.drawn.length = 0")
        before = used(self.server), self.window.of.used
        does()
        self.window.waits(f"new Set(window.drawn.map((d) => d.plot)).size >= {plots}")
        after = used(self.server), self.window.of.used
        self.rest()
        ended = self.window.value("Math.max(...window.drawn.map((d) => d.at)) - window.began")
        return {"wall": ended / 1000, "server": after[0] - before[0], "browser": after[1] - before[1]}

    def rest(self) -> None:
        """Wait until nothing is drawn or computed any more."""
        before = -1.0
        while used(self.server) - before > 0.02:
            before = used(self.server)
            time.sleep(QUIET)

    def press(self, label: str) -> Callable[[], object]:
        """Return what clicks on a button without moving the mouse there, which would draw what it explains."""
        selector = f"[aria-label={json.dumps(label)}]"
        return lambda: self.window.value(f"document.querySelector({json.dumps(selector)}).click()")

    def brush(self) -> None:
        """Drag over marks of the first plot."""
        box = "(({x, y}) => [x, y])(document.querySelector('.js-plotly-plot').getBoundingClientRect())"
        x, y = self.window.value(box)
        self.window.mouse("Moved", x + 100, y + 30)
        self.window.mouse("Pressed", x + 100, y + 30)
        for part in (0.5, 1.0):
            self.window.mouse("Moved", x + 100 + part * 130, y + 30 + part * 130)
        self.window.mouse("Released", x + 230, y + 160)


@contextmanager
def _opened(chromium: Browser, files: list[Path], cache: Path) -> Iterator[_Page]:
    command = [sys.executable, "-m", "rodgen", "open", *map(str, files), "--no-browser"]
    modules = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(cache.with_name("modules"))}
    with chromium.window(1280, 900, WATCH) as window:
        before, began = chromium.used, time.time()
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            env=os.environ | modules | {"RODGEN_CACHE": str(cache)},
        )  # fmt: skip
        try:
            window.goes(process.stdout.readline().strip())
            window.waits(f"new Set((window.drawn || []).map((d) => d.plot)).size >= {PLOTS}")
            times = {"server": used(process.pid), "browser": chromium.used - before}
            ended = window.value("Math.max(...window.drawn.map((d) => d.at))")
            yield _Page(window, process.pid, {"wall": ended / 1000 - began, **times})
        finally:
            process.terminate()
            process.wait()
            process.stdout.close()


def _round(page: _Page, covariate: str) -> Iterator[tuple[str, dict[str, float]]]:
    first = page.window.waits(
        "document.querySelector(\".suspect [aria-label^='Add ']\")?.getAttribute('aria-label')"
    )
    yield "add", page.timed(page.press(first))
    yield "undo", page.timed(page.press("Undo"))
    yield "redo", page.timed(page.press("Redo"))
    yield "undo", page.timed(page.press("Undo"))
    for name in ("order", covariate):  # the page begins with what residuals depend on most
        page.window.value("document.querySelector('[aria-label=\"Against\"]').click()")
        time.sleep(0.5)  # the list unfolds
        options = "[...document.querySelectorAll('[role=option]')]"
        click = f"{options}.find((e) => e.textContent.trim() === {name!r}).click()"
        yield "another covariate", page.timed(lambda click=click: page.window.value(click), plots=1)
    yield "brush", page.timed(page.brush)
    yield "brush", page.timed(page.press("Select none"))
