"""What a browser shows: pages are opened in Chromium, each in a frame of a width, and measured. One start for all."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

__all__ = ["BROWSER", "check_layouts", "needs_browser"]

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")

FRAME = """<!DOCTYPE html><html><head><meta charset="utf-8"></head><body style="margin:0">
%(frames)s
<script>
function measured(frame) {
  var page = frame.contentDocument, view = frame.contentWindow, found = {
    width: page.documentElement.scrollWidth, texts: 0, ticks: 0, plots: 0,
    overlaps: [], outside: [], inside: [], struck: [], clipped: []
  };
  function box(element) {
    var r = element.getBoundingClientRect();
    return { left: r.left, right: r.right, top: r.top, bottom: r.bottom };
  }
  function meet(a, b, by) {
    return a.left < b.right - by && b.left < a.right - by && a.top < b.bottom - by && b.top < a.bottom - by;
  }
  function all(what, inside) { return Array.prototype.slice.call(inside.querySelectorAll(what)); }
  all(".js-plotly-plot", page).forEach(function (plot, number) {
    found.plots++;
    var full = plot._fullLayout, svg = box(plot.querySelector(".main-svg"));
    var areas = Object.keys(full._plots).map(function (key) {
      var x = full._plots[key].xaxis, y = full._plots[key].yaxis;
      return { left: svg.left + x._offset, right: svg.left + x._offset + x._length,
               top: svg.top + y._offset, bottom: svg.top + y._offset + y._length };
    });
    var texts = all(".main-svg text", plot).filter(function (text) {
      return text.textContent.trim() && view.getComputedStyle(text).visibility !== "hidden";
    });
    var grid = all(".gridlayer path, .zerolinelayer path", plot).map(box);
    found.texts += texts.length;
    texts.forEach(function (text, i) {
      var one = box(text), words = number + ": " + text.textContent;
      if (one.left < svg.left - 1 || one.right > svg.right + 1 || one.top < svg.top - 1 || one.bottom > svg.bottom + 1)
        found.outside.push(words);
      for (var k = 0; k < i; k++)
        if (meet(one, box(texts[k]), 1.5)) found.overlaps.push(words + " | " + texts[k].textContent);
      if (text.closest(".xaxislayer-above, .yaxislayer-above, .xaxislayer-below, .yaxislayer-below")) {
        found.ticks++;
        areas.forEach(function (area) { if (meet(one, area, 1.5)) found.inside.push(words); });
      }
      var ground = text.closest(".annotation-text-g"), fill = ground && ground.querySelector("rect.bg");
      if (!fill || view.getComputedStyle(fill).fillOpacity === "0")
        grid.forEach(function (line) { if (meet(one, line, -0.01)) found.struck.push(words); });
    });
  });
  all("table", page).forEach(function (table) {
    var place = table.parentNode;
    var beyond = table.getBoundingClientRect().right - place.getBoundingClientRect().right;
    if (beyond > 1 || place.scrollWidth > place.clientWidth + 1)
      found.clipped.push(table.textContent.trim().slice(0, 60) + " " + place.scrollWidth + " > " + place.clientWidth);
  });
  all(%(count)s, page).forEach(function (element) { found[element.tagName] = (found[element.tagName] || 0) + 1; });
  return found;
}
var frames = Array.prototype.slice.call(document.querySelectorAll("iframe")), waiting = frames.length;
frames.forEach(function (frame) {
  frame.onload = function () {
    // what is folded is drawn when it is unfolded, a moment later
    frame.contentDocument.querySelectorAll("details").forEach(function (part) { part.open = true; });
    waiting--;
    if (waiting === 0) setTimeout(function () { document.title = JSON.stringify(frames.map(measured)); }, 3000);
  };
});
</script></body></html>"""


def measure(pages: Sequence[Path], widths: Sequence[int], count: str) -> tuple[list[dict[str, Any]], str]:
    """Open pages of one folder in frames of every width, and measure them; `count` selects elements to count by tag.

    Returns what was measured, page by page and width by width, and what the browser wrote to its log.
    """
    folder = pages[0].parent
    frames = [
        f'<iframe src="{page.name}" width="{width}" height="900" style="border:0"></iframe>'
        for page in pages
        for width in widths
    ]
    outer = folder / "frames.html"
    outer.write_text(FRAME % {"frames": "\n".join(frames), "count": json.dumps(count)}, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files"]
    options += ["--enable-logging=stderr", f"--user-data-dir={folder / 'profile'}"]
    options += ["--virtual-time-budget=20000", f"--window-size={max(widths) + 20},1000"]
    done = subprocess.run(
        [str(BROWSER), *options, "--dump-dom", outer.as_uri()],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    title = re.search(r"<title>(.*?)</title>", done.stdout, re.DOTALL)
    assert title, done.stderr[-2000:]
    found: list[dict[str, Any]] = json.loads(html.unescape(title[1]))
    return found, done.stderr


def check_layouts(
    pages: Sequence[Path], widths: Sequence[int] = (1280, 390), count: str = "figure"
) -> list[list[dict[str, Any]]]:
    """Assert that nothing overflows, overlaps, is struck through or clipped, and that the browser logs no complaint.

    Returns what was measured of each page at each width.
    """
    measured, log = measure(pages, widths, count)
    for n, found in enumerate(measured):
        page, width = pages[n // len(widths)].name, widths[n % len(widths)]
        assert found["width"] <= width, (page, width)
        for fault in ("overlaps", "outside", "inside", "struck", "clipped"):
            assert not found[fault], (page, width, fault, found[fault])
    assert not [line for line in log.splitlines() if "CONSOLE" in line]
    return [measured[n : n + len(widths)] for n in range(0, len(measured), len(widths))]
