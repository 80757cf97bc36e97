"""Execute rodgen's own derivations and its examples as notebooks; write them into build/notebooks, .ipynb and .html.

The pages include MathJax and plotly.js, so that they need no network.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import nbformat
from nbconvert import HTMLExporter

from rodgen.cli.scripts import packaged_derivations, run_notebook

OUTPUT = Path(__file__).resolve().parent.parent / "build/notebooks"
EXAMPLES = [
    Path(__file__).resolve().parent.parent / "examples" / name
    for name in ("corrected_machine.py", "off_by_20_um.py")
]
MATHJAX = "jupyter-server-mathjax==0.2.6"
# The fonts of this package; by default MathJax looks for others.
FONTS = '"HTML-CSS": { availableFonts: [], preferredFont: null, webFont: "STIX-Web", imageFont: null },'


def bring_mathjax() -> str | None:
    """Install MathJax next to the pages; return its address for them, None when that fails."""
    folder = OUTPUT / "mathjax"
    if not folder.is_dir():
        package = OUTPUT / "package"
        pip = [sys.executable, "-m", "pip", "install", "-qqq", "--no-deps", "--target", str(package), MATHJAX]
        if subprocess.run(pip).returncode:
            print("MathJax cannot be installed: formulas in the .html files need a network to be read")
            return None
        shutil.move(package / "jupyter_server_mathjax/static", folder)
        shutil.rmtree(package)
    return "mathjax/MathJax.js?config=TeX-AMS-MML_HTMLorMML-full,Safe"


def main() -> None:
    OUTPUT.mkdir(parents=True, exist_ok=True)
    mathjax = bring_mathjax()
    exporter = HTMLExporter(exclude_input_prompt=True, exclude_output_prompt=True)
    if mathjax:
        exporter.mathjax_url = mathjax
    for script in (*packaged_derivations(), *map(str, EXAMPLES)):
        start = time.perf_counter()
        name = Path(script).stem
        notebook = OUTPUT / f"{name}.ipynb"
        run_notebook(script, notebook)
        title = f"{name} - rodgen"
        page, _ = exporter.from_notebook_node(
            nbformat.read(notebook, as_version=4), resources={"metadata": {"name": title}}
        )
        if mathjax:
            page = page.replace("tex2jax: {", f"{FONTS}\n                tex2jax: {{", 1)
        notebook.with_suffix(".html").write_text(page, encoding="utf-8")
        print(f"build/notebooks/{name}.ipynb and .html ({time.perf_counter() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
