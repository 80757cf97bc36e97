"""A fitted machine as standalone code: its true places, and the commands that bring it where it should be.

A controller, or whoever has no rodgen, takes these files: forward model, its derivatives, the nominal machine, and the
compensation, with their own test. C99 or C++17 that allocates nothing,
MATLAB, NumPy, or JAX.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rodgen.errors import InputFileError, NotConvergedError, RodgenError, shown

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

__all__ = ["FORMS", "emit"]


FORMS = {
    "c": "C99",
    "cpp": "C++17",
    "matlab": "MATLAB and GNU Octave",
    "numpy": "Python with NumPy",
    "jax": "Python with JAX",
    "urdf": "URDF",
    "dh": "Denavit-Hartenberg tables",
    "tpoint": "model of TPOINT",
    "iso230": "error motions and location errors, ISO 230",
    "screw": "errors of position, for SINUMERIK and LinuxCNC",
    "linuxcnc": "kinematics component for LinuxCNC",
    "printer": "numbers for the firmware of a delta printer",
}
"""What a machine is written as, and what that is."""


def emit(
    machine: Machine,
    lang: str,
    folder: str | os.PathLike[str],
    *,
    name: str | None = None,
    travel: Any = None,
    covariance: tuple[Sequence[str], Any] | None = None,
    residual: tuple[int, float] | None = None,
    into: str | os.PathLike[str] | None = None,
    force: bool = False,
) -> list[Path]:
    """Write a fitted machine as standalone code.

    What is emitted, in machine axes:

    forward
        Joint coordinates, the conditions that the effects depend on (direction of approach, velocity, time,
        temperatures, load, other columns) and the number of a target -> its place, with all errors.
    jacobian
        The same with the derivative with respect to the coordinates, through the effects too.
    ideal
        The place on the nominal machine: its joints as in the machine file, without the effects and without what a fit
        changed in axes and points. A point is that of the target as it is mounted (as it was fitted), which is no error
        of the machine; a direction, such as a line of sight, is that of the file. (In a file that was saved with the
        fitted numbers in place those *are* the file's numbers: emit from the fitted machine, not from that file, to
        correct these too.)
    compensate
        A wanted place, a command and its conditions -> the coordinates that bring the target there, a status, and the
        distance that is left. Where several coordinates serve (more joints than a place has freedoms, joints
        along each other) they are, to first order in the correction, those that change least, each measured by its
        travel (where it has none: a turn, or the size of the machine); other weights may be given, 0 holds a joint.
        A joint that moves no target on the nominal machine is held. They stay within the travels of the file. For what
        cannot be reached the status says so, with the nearest coordinates found: NEAREST on a machine that moves a
        target on a curve or a surface only, such as a rotary table, where that is the best that any command does;
        UNREACHABLE on others.

    What belongs to the machine. Joints, targets and every effect at them do, and so does refraction: it bends what is
    seen, whoever looks. With ``frame = "machine"`` the readings are in machine axes, so what moves that frame
    (drift, a frame shift) is part of the machine as it is seen, and is corrected. With ``frame = "free"`` an instrument
    stood somewhere near the machine: where it stood and how it moved is left out, and places are in machine axes.
    (A drift of the machine itself is an effect of its first joint.) Left out, too, are the instrument's scale and the
    frame shifts of several runs: set-ups are not a property of the machine. The head of each file lists what is in it
    and what is not.

    Where poses were measured a place is twelve numbers: x, y, z and the matrix of the attitude, row by row. A
    compensation brings both to what is wanted, with six joints exactly; with fewer it finds the nearest, where turns
    count as lengths on an arm as long as the machine is large. Where attitudes, angles or inclinations were
    measured it is the matrix of the attitude alone, nine numbers.

    A machine that was fitted to distances moves a point as well, and its commands are corrected to places: a single
    distance does not define one.

    Parameters
    ----------
    machine : Machine
        Fitted, such as ``fit.machine``: every parameter has a value, fitted or held.
    lang : str
        One of :data:`rodgen.machines.emit.FORMS`. ``"c"``: NAME.h, NAME.c and NAME_test.c; C99 in double precision,
        nothing but math.h, no allocation, no state, no recursion, every loop bounded. ``"cpp"``: NAME.hpp and
        NAME_test.cpp; the same as a C++17 header, in the namespace ``rodgen::NAME``. ``"matlab"``: +rodgen/NAME.m and
        NAME_test.m, for MATLAB and GNU Octave, over many columns. ``"numpy"``: NAME.py and test_NAME.py, over many
        rows. ``"jax"``: the same for JAX in double precision, on whatever device it has, for jit, vmap and grad. The
        geometry alone, with what is constant in it: ``"urdf"``, and ``"dh"``, a standard and a modified
        Denavit-Hartenberg table. ``"tpoint"``: a mount as a model of TPOINT. ``"iso230"``: the error motions of each
        axis over its travel, and location errors, with the names of ISO 230. ``"screw"``: the errors of position of
        each axis as tables for SINUMERIK and LinuxCNC. ``"linuxcnc"``: a kinematics component with the C code in it.
        ``"printer"``: radius, rods, angles and endstops of a linear delta, for Klipper, Marlin and RepRapFirmware. Each
        file says what of the model is not in it.
    folder : str or os.PathLike
        Is made where there is none. All files are written, or none.
    name : str, optional
        Lower-case identifier: name of the files and prefix of the C functions; by default made from the machine's name.
    travel : array_like, shape (joints, 2), optional
        Range of each joint in the data, internal units, for effects that are measured over a travel which the machine
        does not give. It does not limit compensations.
    covariance : tuple of keys and ndarray, optional
        Of parameters, internal units, for the uncertainties that tables state.
    residual : tuple of (int, float), optional
        Rows that the machine was fitted to, and the rms of their residuals, internal units, for a model of TPOINT.
    into : str or os.PathLike, optional
        With ``"urdf"``: the URDF that the machine was imported from. It is written with corrected origins of joints;
        all other elements, comments and lines stay as they are. Where the target of the machine file is the tip, a
        fixed joint leads to it where the model has it; otherwise a comment says where the target is on the last link.
    force : bool
        Whether a machine is written, too, that has numbers which no machine has, or was fitted to data that cannot
        belong to its file (`rodgen check`), and whether files that rodgen did not write are replaced.

    Returns
    -------
    list of Path
        The files, in the order of their names. Equal machines give equal bytes.

    Raises
    ------
    InputFileError
        When the machine cannot be right, a parameter has no value, a travel is missing, a file that rodgen did not
        write has the name of one of these, or the folder cannot be written.
    NotConvergedError
        When the fit that the machine is from did not converge.
    RodgenError
        For another language or a bad name, or when the model is finite nowhere.

    Examples
    --------
    >>> import tempfile
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     "Rotary table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in emit(table, "c", folder)]
    ['rotary_table.c', 'rotary_table.h', 'rotary_table_test.c']
    """
    if lang not in FORMS:
        raise RodgenError(f"no language {shown(lang)}; expected one of {', '.join(FORMS)}")
    if into is not None and lang != "urdf":
        raise RodgenError(f"into with {shown(lang)}; expected it with 'urdf' only")
    from rodgen.files import write_files
    from rodgen.machines.emit._content import content_of, named
    from rodgen.machines.emit._render import DO_NOT_EDIT, LANGUAGES, render
    from rodgen.machines.plausible import implausible_numbers

    note = DO_NOT_EDIT
    if into is not None:
        from rodgen.machines.emit._urdf import CORRECTED, corrected_urdf

        note, files = CORRECTED, {Path(into).name: corrected_urdf(machine, into, travel)}
    elif lang in LANGUAGES:
        files = render(content_of(machine, name, travel), lang)
    else:
        files = _tables(machine, lang, named(machine, name), DO_NOT_EDIT, travel, covariance, residual)
    if not force:
        wrong = (machine.doubts() if machine.doubts else "") or "; ".join(implausible_numbers(machine))
        if wrong:
            expected = "a machine that can be right, fitted to the end; --force, in Python force=True, writes it anyway"
            error = NotConvergedError if wrong == NotConvergedError.reason else InputFileError
            raise error(machine.file or machine.name, "file", wrong.rstrip("."), expected)
    for each in () if force else files:
        path = Path(folder, each)
        if path.is_file() and not _written_by_rodgen(path, files[each], note):
            expected = "another folder; --force, in Python force=True, replaces it"
            raise InputFileError(path, "file", "stands there, and rodgen did not write it", expected)
    return write_files(Path(folder), files)


def _tables(
    machine: Machine,
    form: str,
    name: str,
    note: str,
    travel: Any,
    covariance: Any,
    residual: tuple[int, float] | None,
) -> dict[str, str]:
    """Return the text of each file by its name."""
    _check_names(machine)
    if form == "tpoint":
        from rodgen.machines.emit.pointing_terms import tpoint_text

        return {f"{name}.mod": tpoint_text(machine, note, travel, covariance, residual)}
    if form in ("iso230", "screw"):
        from rodgen.machines.emit._error_motions import iso_texts, screw_texts

        if form == "screw":
            return screw_texts(machine, name, note, travel, covariance)
        return iso_texts(machine, name, note, travel, covariance)
    if form == "printer":
        from rodgen.machines.emit._printer import printer_text

        return {f"{name}_firmware.txt": printer_text(machine, note)}
    if form == "linuxcnc":
        from rodgen.machines.emit._render import component_texts

        return component_texts(machine, name, travel)
    from rodgen.machines.emit._denavit_hartenberg import table_texts
    from rodgen.machines.emit._geometry import geometry_of
    from rodgen.machines.emit._numbers import varied
    from rodgen.machines.emit._urdf import urdf_text

    if form == "urdf":
        return {f"{name}.urdf": urdf_text(geometry_of(machine, travel), name, note)}
    geometries = [geometry_of(each, travel) for each in varied(machine, covariance)]
    return table_texts(geometries, name, note)


def _check_names(machine: Machine) -> None:
    """Refuse names that no machine file has: one made in Python may, but here they name files and cells."""
    from rodgen.machines.files.schema import JOINT_NAME, PLACE_NAME
    from rodgen.machines.files.toml import UnfitError

    for what, kind, parts in (("joint", JOINT_NAME, machine.joints), ("target", PLACE_NAME, machine.targets)):
        for part in parts:
            try:
                kind.read(part.name)
            except UnfitError:
                raise InputFileError(
                    machine.file or machine.name, what, shown(part.name), kind.expected
                ) from None


def _written_by_rodgen(path: Path, text: str, note: str) -> bool:
    """Return whether a file has the note, or is a table, which has no place for it, with the same header."""
    content = path.read_text("utf-8", "replace")
    headers = [[cell for cell in x.partition("\n")[0].split(",") if cell[:1] != "U"] for x in (content, text)]
    return note in content or (
        path.suffix == ".csv" and headers[0] == headers[1]
    )  # with uncertainties or without
