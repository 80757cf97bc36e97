"""From the kernels of a derivation to files: NumPy, C, C++, MATLAB, the loops of the gufuncs.

``render`` makes the text in memory; ``write_kernels`` puts it on disk; ``check_kernels`` compares it with the disk.
Nothing in the bytes depends on the time, the place, or the version of anything but SymPy, which is pinned.
"""

from __future__ import annotations

import difflib
import inspect
import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from rodgen.codegen import _array_call
from rodgen.codegen.kernel import Kernel
from rodgen.codegen.kernel_parts import KernelError, Port
from rodgen.codegen.operations import CPP_WORDS, MATLAB_WORDS, OPERATIONS
from rodgen.codegen.program_text import CPP, MACROS, MATLAB, ProgramText, array_language
from rodgen.codegen.source_text import (
    DO_NOT_EDIT,
    ENVIRONMENT,
    REALS,
    matlab_helpers,
    matlab_lines,
    operations_text,
    scale_functions,
)
from rodgen.files import write_files
from rodgen.symbolic import Derivation

USUAL_TARGETS = ("numpy", "c")
"""Languages that are written when none is asked for."""

C_MACROS = {
    MACROS.written[op].partition("(")[0]: (
        f"{op}_{{bits}}" if op in {"sign", "power_of_two_scale"} else row.c.partition("(")[0] + "{f}",
        ", ".join("xy"[: row.c.count("{}")]),
    )
    for op, row in OPERATIONS.items()
    if row.c.endswith(")")
}
"""The macros that the C of kernels calls: the function that each calls, and its arguments.

``{f}`` is the ending of C's functions on floats, ``{bits}`` that of the helpers in the templates.
"""

MATLAB_NAMES = "assembled count eps evaluate given_columns kind NaN realmax real_power real_sqrt select"
"""Names in the template."""

VECTOR_FUNCTIONS = frozenset({"sin", "cos", "atan2"})
"""Elementary functions that have an inline form in the vectorised loops."""
BLOCK = 16
"""Elements a block of the vectorised loops: few enough that the processor loads and stores the neighbouring blocks
while it computes this one. Measured on the solver at 1e7 elements: 16 takes 0.85 of the time of 64, 0.6 of 256."""


ARRAY_CALL = (
    inspect.getsource(_array_call)
    .partition("# Generated modules contain this file from here on.\n")[2]
    .strip()
)
"""The functions of :mod:`rodgen.codegen._array_call`: in each generated NumPy module, or once in a package of them."""

CALL = "numpy/_call.py"
"""The file that has them in a package."""


@dataclass(frozen=True)
class KernelModule:
    """Kernels that are emitted into one file a language."""

    name: str
    """File name without its ending, and prefix of the C functions."""
    summary: str
    """First line of each file."""
    source: str
    """The paper."""
    kernels: tuple[Kernel, ...]
    in_package: bool = False
    """Whether the NumPy file has neighbours, with which it shares ``_call.py``; alone it needs nothing but NumPy."""

    @property
    def enums(self) -> list[dict[str, Any]]:
        """Status enumerations of the kernels, each once."""
        enums: dict[str, type[IntEnum]] = {}
        for kernel in self.kernels:
            for port in kernel.outputs:
                if port.enum is not None:
                    enums.setdefault(port.enum.__name__, port.enum)
        owner: dict[str, str] = {}
        for name, enum in enums.items():
            for member in enum:
                owner_of_member = owner.setdefault(member.name, name)
                if owner_of_member != name:
                    raise KernelError(
                        f"module {self.name}: {owner_of_member} and {name} both have {member.name}; "
                        "C has one place for both: rename one"
                    )
        return [
            {
                "name": name,
                "c_name": re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(),
                "doc": inspect.cleandoc(enum.__doc__ or name).splitlines(),
                "members": list(enum),
            }
            for name, enum in enums.items()
        ]


def render(module: KernelModule, targets: Iterable[str] = USUAL_TARGETS) -> dict[str, str]:
    """Return the text of every file of a module, by path relative to the output folder.

    Parameters
    ----------
    targets : iterable of str, optional
        Keys of :data:`TARGETS`.
    """
    files: dict[str, str] = {}
    for target in targets:
        files |= TARGETS[target](module)
    return files


def numpy_function(kernel: Kernel) -> Callable[..., Any]:
    """Return a kernel as a function on arrays: that of the NumPy file that is generated from it.

    Examples
    --------
    >>> import sympy as sp
    >>> from rodgen.codegen import KernelBuilder
    >>> k = KernelBuilder("hypotenuse", summary="Longest side.", source="Pythagoras")
    >>> a = k.input("a", unit="m", doc="one side")
    >>> b = k.input("b", unit="m", doc="the other side")
    >>> k.output("c", sp.sqrt(a**2 + b**2), unit="m", doc="longest side")
    >>> numpy_function(k.build())([3.0, 5.0], [4.0, 12.0])
    array([ 5., 13.])
    """
    name = "numpy/kernel.py"
    text = render(KernelModule("kernel", kernel.summary, kernel.source, (kernel,)), ["numpy"])[name]
    functions: dict[str, Any] = {}
    exec(compile(text, name, "exec"), functions)
    return cast("Callable[..., Any]", functions[kernel.name])


def _loops(module: KernelModule) -> dict[str, str]:
    kernels = [_loop(kernel, module) for kernel in module.kernels]
    return {f"gufunc/{module.name}_loops.c": _render("gufunc_loops.c.j2", module, kernels)}


def _registration(gufuncs: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Return the files that all modules share."""
    ports = [(*gufunc["inputs"], *gufunc["outputs"]) for gufunc in gufuncs]
    types: dict[str, dict[str, Any]] = {
        "gufunc/gufuncs.c": {"gufuncs": gufuncs},
        "numpy/__init__.py": {"names": [(gufunc["module"], gufunc["name"]) for gufunc in gufuncs]},
        CALL: {"array_call": ARRAY_CALL},
        "gufunc/real.h": {},
        "gufunc/vector.h": {"scale_functions": scale_functions()},
        "gufunc/loop.h": {
            "block": BLOCK,
            "most_ports": max(map(len, ports)),
            "input_sizes": sorted({port["size"] for gufunc in gufuncs for port in gufunc["inputs"]}),
            "output_sizes": sorted(
                {p["size"] for gufunc in gufuncs for p in gufunc["outputs"] if not p["is_status"]}
            ),
            "most_axes": max(1, *(len(port["shape"]) for of_one in ports for port in of_one)),
            "most_numbers": max(
                max(gufunc["input_count"], gufunc["output_count"] + gufunc["angles"]) for gufunc in gufuncs
            ),
        },
    }
    templates = {"numpy/__init__.py": "numpy_init.py.j2", CALL: "numpy_call.py.j2"}
    return {
        name: ENVIRONMENT.get_template(template).render(do_not_edit=DO_NOT_EDIT, template=template, **more)
        for name, more in types.items()
        for template in [templates.get(name, f"{Path(name).name}.j2")]
    }


class Rendered(NamedTuple):
    """What is written for a derivation; :func:`json.dumps` makes a text of it, from which it can be made again."""

    files: dict[str, str]
    gufuncs: list[dict[str, Any]]
    """Of the extension."""


def rendered(
    derivation: Derivation, targets: Iterable[str] = USUAL_TARGETS, *, extension: bool, in_package: bool
) -> Rendered:
    """Return the files of a derivation, with its loops for the extension; none where it has no kernels."""
    if not derivation.kernels:
        return Rendered({}, [])
    kernels = tuple(derivation.kernels.values())
    module = KernelModule(derivation.name, derivation.title, derivation.source, kernels, in_package)
    files = render(module, targets)
    return Rendered(files | _loops(module), _gufuncs(module)) if extension else Rendered(files, [])


def write_kernels(
    derivations: Iterable[Derivation | Rendered],
    folder: Path,
    *,
    targets: Iterable[str] = USUAL_TARGETS,
    extension: bool = False,
) -> list[Path]:
    """Write the generated files of derivations; return the paths whose bytes changed.

    Parameters
    ----------
    derivations : iterable of Derivation or Rendered
        Each becomes one module. Those without kernels are left out.
    folder : Path
        Gets a folder for each target and, for the extension, ``gufunc/``.
    targets : iterable of str, optional
        Keys of :data:`TARGETS`.
    extension : bool
        Whether the loops of NumPy gufuncs are written, too.
    """
    files = _files(derivations, targets, extension, folder)
    changed = {
        name: text
        for name, text in files.items()
        if not (path := folder / name).exists() or path.read_bytes() != text.encode()
    }
    return write_files(folder, changed)


def check_kernels(
    derivations: Iterable[Derivation | Rendered],
    folder: Path,
    *,
    targets: Iterable[str] = USUAL_TARGETS,
    extension: bool = False,
) -> str:
    """Make the files anew and compare them with those in `folder`.

    Returns a unified diff, empty if every byte agrees; with the extension, which all kernels share, it also names files
    that no kernel generates any more.
    """
    files = _files(derivations, targets, extension, folder)
    parts: list[str] = []
    for name, text in sorted(files.items()):
        path = folder / name
        text_there = path.read_bytes().decode(errors="replace") if path.exists() else ""
        parts.extend(
            difflib.unified_diff(
                text_there.splitlines(keepends=True),
                text.splitlines(keepends=True),
                f"committed/{name}",
                f"regenerated/{name}",
            )
        )
    for sub in sorted({Path(name).parent for name in files}) if extension else ():
        for path in sorted((folder / sub).glob("*")):
            name = path.relative_to(folder).as_posix()
            if path.is_file() and path.suffix in {".py", ".c", ".h"} and name not in files:
                parts.append(f"{name}: no kernel makes this file; delete it\n")
    return "".join(parts)


def _files(
    derivations: Iterable[Derivation | Rendered], targets: Iterable[str], extension: bool, folder: Path
) -> dict[str, str]:
    in_package = extension or (folder / CALL).exists()
    parts = [
        d if isinstance(d, Rendered) else rendered(d, targets, extension=extension, in_package=in_package)
        for d in derivations
    ]
    files = {name: text for part in parts for name, text in part.files.items()}
    return (
        files | _registration([gufunc for part in parts for gufunc in part.gufuncs]) if extension else files
    )


# text ----------------------------------------------------------------------------------------------------


def _render(template: str, module: KernelModule, kernels: Sequence[Any], **more: Any) -> str:
    """Return the text of a template; `kernels` holds for each kernel what the template writes of it."""
    functions = {op for k in module.kernels for op, *_ in k.program.operations}
    return ENVIRONMENT.get_template(template).render(
        module=module,
        kernels=kernels,
        exported=_list_of_names([*(e["name"] for e in module.enums), *(k.name for k in module.kernels)]),
        do_not_edit=DO_NOT_EDIT,
        template=template,
        block=BLOCK,
        uses_scale="power_of_two_scale" in functions,
        uses_sign="sign" in functions,
        scale_functions=scale_functions(),
        **more,
    )


def _check_names(module: KernelModule, language: str, reserved: Iterable[str], longest: int = 1000) -> None:
    """Refuse names that a language keeps for itself, or that are too long for it."""
    names = {
        module.name,
        *(e["name"] for e in module.enums),
        *(m.name for e in module.enums for m in e["members"]),
    }
    for k in module.kernels:
        names |= {k.name, *(p.name for p in (*k.inputs, *k.outputs))}
        names |= {s.name for p in k.inputs for s in p.symbols} | {a.symbol.name for a in k.assignments}
    for name in sorted(names):
        if name in reserved or len(name) > longest:
            why = "is reserved" if name in reserved else f"has more than {longest} characters"
            raise KernelError(
                f"module {module.name}: the name {name} {why} in generated {language}; expected another one"
            )


def _read(kernel: Kernel) -> set[str]:
    """Return the names of the components of inputs that are read."""
    used = {tuple(args) for op, *args in kernel.program.operations if op == "input"}
    return {s.name for p in kernel.inputs for i, s in enumerate(p.symbols) if (p.name, i) in used}


def _unread(kernel: Kernel) -> list[Port]:
    """Return the inputs of which no component is read."""
    used = _read(kernel)
    return [p for p in kernel.inputs if used.isdisjoint(s.name for s in p.symbols)]


def _list_of_names(names: Sequence[str]) -> str:
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def _meaning(port: Port) -> str:
    """Return the unit of a port's numbers, or the enumeration whose codes they are."""
    if port.enum is not None:
        return f"codes of {port.enum.__name__}"
    return "no unit" if port.unit == "1" else port.unit


def _numpy_port_line(port: Port) -> str:
    shape = "(" + ("..., " + ", ".join(map(str, port.shape))).rstrip(", ") + ")"
    kind = "int8 array" if port.is_status else "array"
    return f"{port.name} : {kind} {shape}, {_meaning(port)}\n    {port.doc}"


def _c_port_line(port: Port) -> str:
    shape = f" ({', '.join(map(str, port.shape))})" if port.shape else ""
    return f"{port.name}{shape}, {_meaning(port)}: {' '.join(port.doc.split())}"


def _docstring(kernel: Kernel) -> str:
    parts = [kernel.summary, f"Source: {kernel.source}"]
    if kernel.notes:
        parts.append(textwrap.dedent(kernel.notes).strip())
    for title, ports in (("Parameters", kernel.inputs), ("Returns", kernel.outputs)):
        parts.append("\n".join([title, "-" * len(title), *(_numpy_port_line(p) for p in ports)]))
    return textwrap.indent("\n\n".join(parts), "    ").strip()


# NumPy ---------------------------------------------------------------------------------------------------


def _numpy_files(module: KernelModule) -> dict[str, str]:
    text = _render("numpy.py.j2", module, _numpy_kernels(module), array_call=ARRAY_CALL)
    return {f"numpy/{module.name}.py": text}


def _numpy_kernels(module: KernelModule) -> list[dict[str, Any]]:
    return [
        {
            "name": kernel.name,
            "signature": ", ".join(p.name for p in kernel.inputs),
            "docstring": _docstring(kernel),
            "arguments": _tuple(p.name for p in kernel.inputs),
            "input_ports": _tuple((f'("{p.name}", {p.shape})' for p in kernel.inputs), parentheses=True),
            "output_ports": _tuple(
                (f'("{p.name}", {p.shape}, {p.is_status})' for p in kernel.outputs), parentheses=True
            ),
            "gufunc_signature": _gufunc_signature(kernel),
            "types": _list_of_names([_type_codes(kernel, code) for code in "df"]),
            "components": ", ".join(s.name for p in kernel.inputs for s in p.symbols),
            "bodies": [_numpy_body(k) for k in _with_usual_case(kernel)],
        }
        for kernel in module.kernels
    ]


def _with_usual_case(kernel: Kernel) -> list[Kernel]:
    """Return the kernel and, where it has one, its usual case."""
    return [kernel] if kernel.usual is None else [kernel, kernel.usual_case()]


WAITING = 16
"""So many arrays that no later line reads are kept at most: few enough for those in use to stay in the cache."""


def _numpy_body(kernel: Kernel) -> dict[str, Any]:
    text = kernel.text(array_language("xp"))
    lines, done = list[str](), list[str]()
    for line in text.lines:
        lines.append(f"{line.name} = {line.text}")
        done += line.done
        if len(done) >= WAITING:
            lines.append(f"del {', '.join(done)}")
            done = []
    return {
        "function": f"_{kernel.name}",
        "operations": operations_text(text.operations),
        "lines": lines,
        "results": _tuple((x for p in kernel.outputs for x in text.results[p.name]), parentheses=True),
    }


def _tuple(items: Iterable[str], *, parentheses: bool = False) -> str:
    """Return the source text of a Python tuple."""
    items = list(items)
    text = ", ".join(items) + ("," if len(items) == 1 else "")
    return f"({text})" if parentheses else text


# C -------------------------------------------------------------------------------------------------------


def _c_files(module: KernelModule) -> dict[str, str]:
    kernels = [_c_kernel(kernel, module) for kernel in module.kernels]
    return {
        f"c/{module.name}.h": _render("c.h.j2", module, kernels),
        f"c/{module.name}.c": _render("c.c.j2", module, kernels, macros=_macros_called(kernels)),
    }


def _macros_called(kernels: Sequence[dict[str, Any]]) -> dict[str, tuple[str, str]]:
    """Return those of `C_MACROS` that the lines of the kernels call."""
    written = "\n".join(line for kernel in kernels for line in (*kernel["body"], *kernel["stores"]))
    return {name: macro for name, macro in C_MACROS.items() if re.search(rf"\b{name}\(", written)}


def _comment(kernel: Kernel) -> list[str]:
    """Return the lines of a comment on a kernel."""
    lines = [kernel.summary, f"Source: {kernel.source}", f"Operations: {operations_text(kernel.operations)}"]
    return lines + [_c_port_line(p) for p in (*kernel.inputs, *kernel.outputs)]


def _lines_of_c(
    kernel: Kernel,
    text: ProgramText,
    types: tuple[str, str],
    place: Callable[[Port, int], str],
    code: Callable[[Port], str],
    angles: Sequence[str] = (),
) -> tuple[list[str], list[str]]:
    """Return the lines of C or C++ that compute, and those that store the outputs, and angles for a later look.

    `types` are those of numbers and conditions; `place` writes what a component of an output is stored in, `code` with
    ``{}`` the conversion to a code of a status.
    """
    stored = Counter(x for p in kernel.outputs for x in text.results[p.name])
    codes = {x for p in kernel.outputs if p.is_status for x in text.results[p.name]}
    late = {
        line.name: line.text
        for line in text.lines
        if stored[line.name] == 1 and not line.is_read and line.name not in {*codes, *angles}
    }
    body = [
        f"const {types[line.is_condition]} {line.name} = {line.text};"
        for line in text.lines
        if line.name not in late
    ]
    stores = [
        f"{place(port, i)} = {(code(port) if port.is_status else '{}').format(late.get(x, x))};"
        for port in kernel.outputs
        for i, x in enumerate(text.results[port.name])
    ]
    return body, [*stores, *(f"ANGLE({n}, {angle});" for n, angle in enumerate(angles))]


def _c_kernel(kernel: Kernel, module: KernelModule) -> dict[str, Any]:
    used = _read(kernel)
    body, stores = _lines_of_c(
        kernel,
        kernel.macros,
        ("REAL", "CONDITION"),
        lambda port, i: f"{port.name}[AT({i})]" if port.shape else f"*{port.name}",
        lambda port: "(CODE){}",
        _angles(kernel),
    )
    ports = [*((p, False) for p in kernel.inputs), *((p, True) for p in kernel.outputs)]
    return {
        "name": kernel.name,
        "function": f"{module.name}_{kernel.name}",
        "comment": "\n * ".join(_comment(kernel)),
        "operations": operations_text(kernel.operations),
        "vectorised": _is_vectorised(kernel),
        "parameters": _parameters(kernel, "REAL", "CODE"),
        "loads": [
            f"const REAL {s.name} = {p.name}[AT({i})];"
            for p in kernel.inputs
            if p.shape != ()
            for i, s in enumerate(p.symbols)
            if s.name in used
        ]
        + [f"(void){p.name};" for p in _unread(kernel)],  # no warning for those
        "body": body,
        "stores": stores,
        "batch_call": ", ".join(_element(p, output=output) for p, output in ports),
        "prototype": {real: _parameters(kernel, real) for real in REALS.values()},
        "batch_prototype": {
            real: ", ".join(
                ["size_t count"]
                + [f"const {real} *{p.name}" for p in kernel.inputs]
                + [f"{'int8_t' if p.is_status else real} *{p.name}" for p in kernel.outputs]
            )
            for real in ("REAL", *REALS.values())
        },
    }


def _parameters(kernel: Kernel, real: str, code: str = "int8_t") -> str:
    """Return the parameters of the C function of a kernel."""
    kinds = {True: code, False: real}
    return ", ".join(
        [f"const {real} {p.name}[{p.size}]" if p.shape else f"{real} {p.name}" for p in kernel.inputs]
        + [
            f"{kinds[p.is_status]} {p.name}[{p.size}]" if p.shape else f"{kinds[p.is_status]} *{p.name}"
            for p in kernel.outputs
        ]
    )


def _element(port: Port, *, output: bool) -> str:
    if port.shape == ():
        return f"{port.name} + i" if output else f"{port.name}[i]"
    return f"{port.name} + {port.size} * i"


# C++ -----------------------------------------------------------------------------------------------------


def _cpp_files(module: KernelModule) -> dict[str, str]:
    _check_names(module, "C++", CPP_WORDS.split())
    kernels = [_cpp_kernel(kernel) for kernel in module.kernels]
    return {f"cpp/{module.name}.hpp": _render("cpp.hpp.j2", module, kernels)}


def _cpp_kernel(kernel: Kernel) -> dict[str, Any]:
    only = len(kernel.outputs) == 1
    out = "out" if only else "out.{}"
    body, stores = _lines_of_c(
        kernel,
        kernel.text(CPP),
        ("Real", "bool"),
        lambda port, i: (
            out.format(port.name) + "".join(f"[{at}]" for at in np.unravel_index(i, port.shape) if port.shape)
        ),
        lambda port: f"static_cast<{port.enum.__name__ if port.enum else 'int'}>({{}})",
    )
    used = _read(kernel)
    return {
        "name": kernel.name,
        "comment": _comment(kernel),
        "returns": _cpp_type(kernel.outputs[0]) if only else f"{kernel.name}_result<Real>",
        "members": [] if only else [(_cpp_type(p), p.name) for p in kernel.outputs],
        "parameters": ", ".join(
            f"const {_cpp_type(p)} &{p.name}" if p.shape else f"Real {p.name}" for p in kernel.inputs
        ),
        "unread": [p.name for p in _unread(kernel)],
        "loads": [
            f"const Real {s.name} = {p.name}{''.join(f'[{j}]' for j in place)};"
            for p in kernel.inputs
            if p.shape
            for s, place in zip(p.symbols, np.ndindex(p.shape), strict=True)
            if s.name in used
        ],
        "body": body,
        "stores": stores,
    }


def _cpp_type(port: Port) -> str:
    """Return the type of a port: a number, a code, or an array (of arrays) of them."""
    kind = port.enum.__name__ if port.enum is not None else "Real"
    for length in reversed(port.shape):
        kind = f"std::array<{kind}, {length}>"
    return kind


# MATLAB --------------------------------------------------------------------------------------------------


def _matlab_files(module: KernelModule) -> dict[str, str]:
    names = {row.matlab.partition("(")[0] for row in OPERATIONS.values() if row.matlab.endswith(")")}
    _check_names(module, "MATLAB", {*MATLAB_WORDS.split(), *MATLAB_NAMES.split(), *names}, 63)
    folder = f"matlab/+rodgen/+{module.name}"
    files = {
        f"{folder}/{kernel.name}.m": _render("kernel.m.j2", module, [], kernel=_matlab_kernel(kernel))
        for kernel in module.kernels
    }
    return files | {
        f"{folder}/{enum['name']}.m": _render("codes.m.j2", module, [], enum=enum) for enum in module.enums
    }


_MATLAB_NUMBER_TYPE = {"eps": "eps(kind)", "largest": "realmax(kind)"}


def _matlab_kernel(kernel: Kernel) -> dict[str, Any]:
    used, text = _read(kernel), kernel.text(MATLAB._replace(inputs=_MATLAB_NUMBER_TYPE))
    lines = []
    for port in kernel.inputs:
        rows = [port.symbols[i] for i in _columnwise(port.shape)] if port.shape else []
        lines += [f"{s.name} = {port.name}({i}, :);" for i, s in enumerate(rows, 1) if s.name in used]
    lines += [f"{line.name} = {line.text};" for line in text.lines]
    for port in kernel.outputs:
        components = ", ".join(text.results[port.name][i] for i in _columnwise(port.shape))
        kind = "'int32'" if port.is_status else "kind"
        lines.append(f"{port.name} = assembled({_sizes(port) or 1}, count, {kind}, {components});")
    return {
        "name": kernel.name,
        "comment": _comment(kernel),
        "inputs": [p.name for p in kernel.inputs],
        "outputs": [p.name for p in kernel.outputs],
        "given": [f"{{'{p.name}', {_sizes(p) or '[]'}, {p.name}}}" for p in kernel.inputs],
        "lines": [part for line in lines for part in matlab_lines(line)],
        "helpers": matlab_helpers("\n".join(lines)),
    }


def _columnwise(shape: tuple[int, ...]) -> list[int]:
    """Return the numbers of components that are stored row by row in the order in which MATLAB stores an array."""
    return list(np.arange(math.prod(shape)).reshape(shape).ravel(order="F"))


def _sizes(port: Port) -> str:
    return f"[{' '.join(map(str, port.shape))}]" if port.shape else ""


# gufunc --------------------------------------------------------------------------------------------------


def _is_vectorised(kernel: Kernel) -> bool:
    return kernel.functions <= VECTOR_FUNCTIONS


def _angles(kernel: Kernel) -> list[str]:
    """Return the angles that may be too large for the sine and cosine of the vectorised loops."""
    return [kernel.macros.names[x] for x in kernel.angles] if _is_vectorised(kernel) else []


def _gufuncs(module: KernelModule) -> list[dict[str, Any]]:
    return [_gufunc(kernel, module) for kernel in module.kernels]


def _gufunc(kernel: Kernel, module: KernelModule) -> dict[str, Any]:
    """Return what all kernels of the extension are registered with, as plain data."""
    inputs, outputs = (
        [{"size": p.size, "shape": p.shape, "is_status": p.is_status} for p in ports]
        for ports in (kernel.inputs, kernel.outputs)
    )
    return {
        "module": module.name,
        "name": kernel.name,
        "function": f"{module.name}_{kernel.name}",
        "doc": kernel.summary.replace('"', '\\"'),
        "signature": _gufunc_signature(kernel),
        "inputs": inputs,
        "outputs": outputs,
        "input_count": sum(p.size for p in kernel.inputs),
        "output_count": sum(p.size for p in kernel.outputs),
        "angles": len(_angles(kernel)),
    }


def _loop(kernel: Kernel, module: KernelModule) -> dict[str, Any]:
    vectorised = _is_vectorised(kernel)
    return _gufunc(kernel, module) | {
        "ports": ", ".join(map(_port_initializer, (*kernel.inputs, *kernel.outputs))),
        "row": _arguments(kernel, "x[{}]", "x + {}", "y + {}", "codes + {}"),
        "columns": _arguments(kernel, "input[{}][i]", "input[{}] + i", "output[{}] + i", "output[{}] + i"),
        "vectorised": vectorised,
        "usual": _usual_case(kernel, module) if vectorised and kernel.usual else None,
    }


def _usual_case(kernel: Kernel, module: KernelModule) -> dict[str, Any]:
    """Return the C function of the usual case, whose last output is a condition."""
    kernel_text = _c_kernel(kernel.usual_case(), module)
    return kernel_text | {
        "parameters": kernel_text["parameters"].replace("REAL *is_usual", "CONDITION *is_usual")
    }


def _port_initializer(port: Port) -> str:
    """Return a port as the initializer of a ``struct port``."""
    return f"{{{port.size}, {int(port.is_status)}, {len(port.shape)}, {{{', '.join(map(str, port.shape)) or 0}}}}}"


def _arguments(kernel: Kernel, number: str, array: str, output: str, code: str) -> str:
    """Return the arguments of the C function: how each is written, with ``{}`` for the place of its first component."""
    arguments, at = [], 0
    for port in kernel.inputs:
        arguments.append((array if port.shape else number).format(at))
        at += port.size
    at = 0
    for port in kernel.outputs:
        arguments.append((code if port.is_status else output).format(at))
        at += port.size
    return ", ".join(arguments)


def _gufunc_signature(kernel: Kernel) -> str:
    def core(port: Port) -> str:
        return "(" + ",".join(map(str, port.shape)) + ")"

    return ",".join(map(core, kernel.inputs)) + "->" + ",".join(map(core, kernel.outputs))


def _type_codes(kernel: Kernel, real: str) -> str:
    return real * len(kernel.inputs) + "->" + "".join("b" if p.is_status else real for p in kernel.outputs)


TARGETS: Mapping[str, Callable[[KernelModule], dict[str, str]]] = {
    "numpy": _numpy_files,
    "c": _c_files,
    "cpp": _cpp_files,
    "matlab": _matlab_files,
}
"""What writes the files of a module in each language."""
