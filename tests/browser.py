"""What a browser shows: a page is opened in Chromium at a width, and measured."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

__all__ = ["BROWSER", "check_layout", "measure", "needs_browser"]

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None
)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")

FRAME = """<!DOCTYPE html><html><head><meta charset="utf-8"></head><body style="margin:0">
<iframe id="f" src="%(page)s" width="%(width)d" height="900" style="border:0"></iframe>
<script>
document.getElementById("f").onload = function () {
  var page = this.contentDocument, view = this.contentWindow, found = {
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
    var closed = table.closest("details");
    if (closed && !closed.open) closed.open = true;
    var place = table.parentNode;
    var beyond = table.getBoundingClientRect().right - place.getBoundingClientRect().right;
    if (beyond > 1 || place.scrollWidth > place.clientWidth + 1)
      found.clipped.push(table.textContent.trim().slice(0, 60) + " " + place.scrollWidth + " > " + place.clientWidth);
  });
  all(%(count)s, page).forEach(function (element) { found[element.tagName] = (found[element.tagName] || 0) + 1; });
  document.title = JSON.stringify(found);
};
</script></body></html>"""


def measure(page: Path, width: int, count: str = "figure") -> tuple[dict[str, Any], str]:
    """Open a page in a frame of a width, and measure it.

    Returns what was measured, and what the browser wrote to its log. `count` selects elements that are counted by tag.
    """
    frame = page.with_name(f"frame_{width}.html")
    given = {"page": page.name, "width": width, "count": json.dumps(count)}
    frame.write_text(FRAME % given, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files"]
    options += ["--enable-logging=stderr", f"--user-data-dir={page.parent / f'profile_{width}'}"]
    options += ["--virtual-time-budget=20000", f"--window-size={max(width, 500) + 20},1000"]
    done = subprocess.run(
        [str(BROWSER), *options, "--dump-dom", frame.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    title = re.search(r"<title>(.*?)</title>", done.stdout, re.DOTALL)
    assert title, done.stderr[-2000:]
    found: dict[str, Any] = json.loads(html.unescape(title[1]))
    return found, done.stderr


def check_layout(page: Path, width: int, count: str = "figure") -> dict[str, Any]:
    """Assert that nothing overflows, overlaps, is struck through or clipped, and that the browser logs no complaint."""
    found, log = measure(page, width, count)
    assert found["width"] <= width
    for fault in ("overlaps", "outside", "inside", "struck", "clipped"):
        assert not found[fault], (fault, found[fault])
    assert not [line for line in log.splitlines() if "CONSOLE" in line]
    return found
