"""Build the documentation site into build/site.

    python docs/site/build.py [-j 2] [--links]     # make docs

The pages are the Markdown files of the repository, which a code host shows as well, the executed derivations, and
reference pages that are made from what they describe. They are collected in build/site-source with links for the
site, and Sphinx makes HTML from them: nothing on a page asks a network for anything. Warnings are errors.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import check
import notebooks
import reference
from links import DeadLinkError, Links
from outline import DERIVATIONS, MODULES, NAMES, OUTLINE
from papers import PAPERS, paper_page
from sphinx.cmd.build import main as sphinx

ROOT = Path(__file__).resolve().parents[2]
SOURCE, SITE, CACHE = (ROOT / "build" / name for name in ("site-source", "site", "site-cache"))
FIGURE = "application/vnd.plotly.v1+json"
_ANCHOR = re.compile(r'<a id="(.*?)">')
_LINK = re.compile(r'<a href="#(.*?)">(.*?)</a>')


def pages() -> dict[str, str]:
    """Return the files of the repository that are pages, with the names of the pages."""
    found = {"README.md": "index.md", "docs/README.md": "index.md"}
    for section in OUTLINE:
        for name, file in section.pages.items():
            if file:
                found[file] = f"{section.folder}/{name}" + (".ipynb" if file.endswith(".py") else ".md")
    return found | {f"derivation/{name}.py": f"science/derivations/{name}.ipynb" for name in NAMES}


class Source:
    """The source folder of the site; a file is written only if it changes, so that Sphinx reads only those again."""

    def __init__(self) -> None:
        self.written: set[Path] = set()

    def write(self, name: str, text: str) -> None:
        path = SOURCE / name
        self.written.add(path)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")

    def remove_others(self, kept: set[Path]) -> None:
        for path in SOURCE.rglob("*"):
            if path.is_file() and path not in self.written | kept:
                path.unlink()


def collect(names: list[str]) -> None:
    """Write the source folder of the site."""
    source, where = Source(), pages()
    links = Links(ROOT, where, SOURCE)
    missing = set(names) - set(NAMES) - set(notebooks.EXAMPLES)
    if missing:
        sys.exit(
            f"docs/site/outline.py does not say where these derivations belong: {', '.join(sorted(missing))}"
        )
    for file, page in where.items():
        if page.endswith(".ipynb"):
            executed = notebooks.FOLDER / f"{Path(file).stem}.ipynb"
            source.write(page, notebook(json.loads(executed.read_text(encoding="utf-8")), links, file))
        elif page != "index.md":
            text = (ROOT / file).read_text(encoding="utf-8")
            source.write(page, links.rewrite(text, file))
    source.write("index.md", first_page(links))
    records = {name: notebooks.record(name) for name in NAMES}
    titles = {name: record["title"] for name, record in records.items()}
    source.write("science/derivations.md", derivations_page(records))
    source.write("science/errata.md", errata_page(records))
    for page, (title, those) in PAPERS.items():
        of_paper = {name: records[name] for name in those}
        text = paper_page(ROOT, title, of_paper, {name: shown_entries(name) for name in those})
        source.write(f"science/{page}.md", text)
    source.write("reference/catalogue.md", reference.effects_page())
    source.write("reference/kernels.md", reference.kernels_page(ROOT, titles))
    for name, text in reference.command_pages().items():
        source.write(f"reference/{name}.md", text)
    for name, text in reference.module_pages(MODULES).items():
        source.write(f"reference/{name}", text)
    source.remove_others(links.copied)


def first_page(links: Links) -> str:
    """Return the README, with cards in place of its list of pages, and the table of contents."""
    text, _, _ = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Where to read on")
    lines = [
        links.rewrite(text, "README.md"),
        "## Where to read on",
        "",
        "::::{grid} 1 2 2 2",
        ":gutter: 3",
        "",
    ]
    for section in OUTLINE:
        first = f"/{section.folder}/{next(iter(section.pages))}"
        lines += [f":::{{grid-item-card}} {section.title}", f":link: {first}", ":link-type: doc"]
        lines += [section.text, ":::", ""]
    lines += ["::::", ""]
    for section in OUTLINE:
        places = {name: f"{section.folder}/{name}" for name in section.pages}
        entries = [f"{section.titles[n]} <{p}>" if n in section.titles else p for n, p in places.items()]
        lines.append(reference.toctree(entries, hidden=True, caption=section.title))
    return "\n".join(lines)


def derivations_page(records: dict[str, dict]) -> str:
    """Return the list of the derivations."""
    proved, refuted = (
        sum(record[verdict] for record in records.values()) for verdict in ("proved", "refuted")
    )
    lines = [
        "# Derivations",
        "",
        f"Every formula of the sources is stated here and proved, or refuted with an exact counterexample: {proved} "
        f"are proved, {refuted} refuted, by SymPy, when these pages are made. Code that runs is made from the same "
        "expressions. The cells of code are folded; a click opens them.",
        "",
    ]
    for subject, names in DERIVATIONS.items():
        lines += [f"## {subject}", "", "| derivation | proved | refuted |", "| --- | ---: | ---: |"]
        for name in names:
            record = records[name]
            link = f"[{record['title']}](derivations/{name}.ipynb)"
            lines.append(f"| {link} | {record['proved']} | {record['refuted'] or ''} |")
        lines.append("")
    return "\n".join([*lines, reference.toctree([f"derivations/{name}" for name in records], hidden=True)])


def errata_page(records: dict[str, dict]) -> str:
    """Return what is wrong in the sources."""
    lines = [
        "# Errata of the sources",
        "",
        "Formulas and statements of the papers and notes that the derivations refute, each with an exact "
        "counterexample and the correction.",
        "",
    ]
    for name, record in records.items():
        if record["errata"]:
            text = re.sub(r"^#", "##", record["errata"], flags=re.MULTILINE)
            text = re.sub(r"^## Errata: ", "## ", text, flags=re.MULTILINE)
            lines += [
                text.rstrip(),
                "",
                f"The derivation: [{record['title']}](derivations/{name}.ipynb).",
                "",
            ]
    return "\n".join(lines)


def shown_entries(name: str) -> set[str]:
    """Return the entries that the page of a derivation shows: places to which links lead."""
    content = json.loads((notebooks.FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    return set(_ANCHOR.findall("\n".join(_texts(content))))


def notebook(content: dict, links: Links, file: str) -> str:
    """Return an executed notebook as a page: links for the site, figures drawn by one script, proofs' code folded."""
    shown = set(_ANCHOR.findall("\n".join(_texts(content))))
    for cell in content["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = links.rewrite("".join(cell["source"]), file)
            continue
        if file.startswith("examples/"):  # they are about their code, the derivations about their proofs
            cell["metadata"] = {}  # not folded
        for output in cell["outputs"]:
            data = output.get("data", {})
            if FIGURE in data:
                output["data"] = {"text/html": figure(data[FIGURE])}
                output["metadata"] = {}
            elif "text/markdown" in data:
                text = "".join(data["text/markdown"])
                # a statement that no cell shows has no place to lead to
                data["text/markdown"] = _LINK.sub(lambda m: m[0] if m[1] in shown else m[2], text)
    content["metadata"].pop("widgets", None)
    return json.dumps(content, indent=1, ensure_ascii=False)


def _texts(content: dict) -> Iterator[str]:
    for cell in content["cells"]:
        for output in cell.get("outputs", []):
            yield "".join(output.get("data", {}).get("text/markdown", ""))


def figure(data: dict) -> str:
    """Return a figure as HTML: its data, which static/figures.js draws."""
    text = json.dumps({key: data[key] for key in ("data", "layout")}).replace("<", "\\u003c")
    return f'<div class="site-figure"><script type="application/json">{text}</script></div>'


def main() -> None:
    """Build the site."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "-j", "--jobs", type=int, default=1, help="notebooks that are executed at the same time"
    )
    parser.add_argument(
        "--links", action="store_true", help="only check the links to other sites, which needs a network"
    )
    options = parser.parse_args()
    start = time.perf_counter()
    names = notebooks.execute_all(options.jobs)
    try:
        collect(names)
    except DeadLinkError as error:
        sys.exit(str(error))
    builder = "linkcheck" if options.links else "html"
    output = ROOT / "build/site-links" if options.links else SITE
    arguments = [
        "-b",
        builder,
        "-c",
        str(Path(__file__).parent),
        "-d",
        str(CACHE),
    ]  # one process: a fork with threads may hang
    code = sphinx([*arguments, "-n", "-W", "--keep-going", str(SOURCE), str(output)])
    if code:
        sys.exit(code)
    if not options.links:
        wrong = check.faults(SITE)
        if wrong:
            sys.exit("\n".join(wrong))
        print(f"build/site/index.html ({time.perf_counter() - start:.0f} s)")


if __name__ == "__main__":
    main()
