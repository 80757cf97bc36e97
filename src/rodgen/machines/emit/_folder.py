"""Write several files into a folder: all of them, or none."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from rodgen.errors import InputFileError
from rodgen.files import AtomicFile

__all__ = ["write_files"]


def write_files(folder: Path, files: Mapping[str, str]) -> list[Path]:
    """Write texts by file name; no file gets its final name before all are written.

    Parameters
    ----------
    folder : Path
        Is made where there is none, and taken away again when the files cannot be written.
    files : mapping of str to str

    Returns
    -------
    list of Path
        Sorted.

    Raises
    ------
    InputFileError
        When the folder cannot be made or written.
    """
    names = sorted(files)
    paths = [folder / name for name in names]
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    new = [path for path in paths if not path.exists()]
    targets = [AtomicFile(str(path)) for path in paths]
    complete = False
    try:
        _make(folder, paths)
        for target, name in zip(targets, names, strict=True):
            with target.open() as stream, _told(target):
                stream.write(files[name].encode())
        for target in targets:
            with _told(target):
                target.commit()
        complete = True
    finally:
        for target in targets:
            target.discard()
        if not complete:
            for path in new:
                with contextlib.suppress(OSError):
                    path.unlink()
            for parent in missing:
                with contextlib.suppress(OSError):
                    parent.rmdir()
    return paths


def _make(folder: Path, paths: list[Path]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputFileError(
            folder, "file", f"no folder can be made ({reason})", "a writable place"
        ) from None
    for path in paths:
        if path.is_dir():
            raise InputFileError(path, "file", "a folder stands in its place", "a file, or nothing")


@contextlib.contextmanager
def _told(target: AtomicFile) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise target.error(error) from None
