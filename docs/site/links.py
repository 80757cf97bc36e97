"""Links between files of the repository, written for a code host, as links between pages of the site."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePosixPath

__all__ = ["LINK", "DeadLinkError", "Links", "prose"]

LINK = re.compile(r"(?<=\]\()(?![a-z]+:)([^()\s]+)(?=\))")
"""A link of Markdown to a place that is not on another site."""
_FENCE = re.compile(r"^ *(```|~~~)")


class DeadLinkError(Exception):
    """A link leads nowhere."""


def prose(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the lines of a Markdown text with their ends, and whether each is prose; the others are code."""
    fence, blank, indented = "", True, False
    for line in text.splitlines(keepends=True):
        mark = _FENCE.match(line)
        if fence or mark:
            yield line, False
            fence = "" if fence and line.strip() == fence else fence or (mark[1] if mark else "")
            continue
        indented = line.startswith("    ") and (blank or indented)
        blank = not line.strip()
        yield line, not indented


class Links:
    """Where the links of a page lead on the site.

    Parameters
    ----------
    root : Path
        The repository.
    pages : mapping of str to str
        Files of the repository, and the names of their pages.
    folder : Path
        The source folder of the site. What is linked and is no page is copied into it, to be downloaded: a file as it
        is, a folder as a ZIP file.
    """

    def __init__(self, root: Path, pages: Mapping[str, str], folder: Path) -> None:
        self.root, self.pages, self.folder = root, pages, folder
        self.copied: set[Path] = set()

    def rewrite(self, text: str, file: str) -> str:
        """Return the text of a file of the repository with links for the site.

        Raises
        ------
        DeadLinkError
            When a link leads nowhere.
        """
        follow: Callable[[re.Match[str]], str] = lambda match: self._target(match[1], file)  # noqa: E731
        return "".join(LINK.sub(follow, line) if is_prose else line for line, is_prose in prose(text))

    def _target(self, link: str, file: str) -> str:
        path, mark, anchor = link.partition("#")
        if not path:
            return link
        place = (self.root / file).parent.joinpath(path).resolve()
        if not place.exists() or not place.is_relative_to(self.root):
            raise DeadLinkError(f"{file}: the link {link} leads nowhere")
        relative = place.relative_to(self.root).as_posix()
        readme = f"{relative}/README.md"
        page = self.pages.get(relative) or self.pages.get(readme)
        if page:
            return f"/{page}{mark}{anchor}"
        return "/" + self._copy(place, relative).as_posix()

    def _copy(self, place: Path, relative: str) -> PurePosixPath:
        target = PurePosixPath("files", relative)
        if place.is_dir():
            target = target.with_name(target.name + ".zip")
            self._write(target, lambda path: _zip(place, path))
        else:
            self._write(target, lambda path: shutil.copyfile(place, path))
        return target

    def _write(self, target: PurePosixPath, write: Callable[[Path], object]) -> None:
        path = self.folder / target
        if path not in self.copied:
            self.copied.add(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)


def _zip(folder: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                entry = zipfile.ZipInfo(
                    f"{folder.name}/{file.relative_to(folder).as_posix()}"
                )  # without a time
                archive.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)
