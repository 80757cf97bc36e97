"""The emitted C without Python, under the address and undefined-behaviour sanitizers, on the same references.

A driver is written for the occasion: it reads the inputs from a file into heap blocks of exactly their size, calls
a kernel one element at a time, as a batch, and through the loop of its gufunc, also on arrays that are spread in memory
or run backwards, and writes the results. It also gets numbers that are none, or far too large, and no rows at all.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from kernel_reference import GENERATED, MODULE_OF, expected, of_kernels

from conftest import C_FOLDER, C_MODULES, C_WARNINGS

# -O0 keeps every access that the source makes, and compiles in a fifth of the time of -O1. No pointer to a local leaves
# its scope in straight-line code, and to guard each scope takes GCC minutes where a function has a thousand locals.
SANITIZERS = [
    "-fsanitize=address,undefined",
    "-fsanitize=float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-fno-sanitize-address-use-after-scope",
    "-fno-omit-frame-pointer",
    "-g",
    "-O0",
]
MANNERS = ("one", "batch", "loop", "spread", "backwards")
"""How a kernel is called; the last three through the loop of its gufunc."""

DRIVER = """
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
{includes}
{declarations}

static void *read_block(FILE *file, size_t bytes) {{
  void *block = malloc(bytes);
  if (block == NULL || fread(block, 1, bytes, file) != bytes)
    exit(3);
  return block;
}}

/* The same numbers with a gap of one after each, in a block that ends with the last. */
static void *spread(void *block, size_t count, size_t width) {{
  char *wide = malloc(count ? (2 * count - 1) * width : 1);
  if (wide == NULL)
    exit(3);
  for (size_t i = 0; i < count; ++i)
    memcpy(wide + 2 * i * width, (char *)block + i * width, width);
  free(block);
  return wide;
}}

static void *gathered(void *wide, size_t count, size_t width) {{
  char *block = malloc(count * width + 1);
  if (block == NULL)
    exit(3);
  for (size_t i = 0; i < count; ++i)
    memcpy(block + i * width, (char *)wide + 2 * i * width, width);
  free(wide);
  return block;
}}

static void write_block(FILE *file, void *block, size_t bytes) {{
  if (fwrite(block, 1, bytes, file) != bytes)
    exit(4);
  free(block);
}}
{functions}
int main(int count, char **words) {{
  if (count != 4)
    return 2;
  FILE *in = fopen(words[2], "rb"), *out = fopen(words[3], "wb");
  if (in == NULL || out == NULL)
    return 2;
{calls}
  fclose(in);
  return fclose(out);
}}
"""


def function(name: str, bits: int, manner: str) -> str:
    kernel = GENERATED[name]
    real = "double" if bits == 64 else "float"
    call = f"{GENERATED[name].module}_{name}"
    lines, frees, writes = ["size_t n;", "if (fread(&n, sizeof n, 1, in) != 1) exit(2);"], [], []
    for port in kernel.inputs:
        lines.append(f"{real} *{port.name} = read_block(in, n * {port.size} * sizeof({real}));")
        frees.append(f"free({port.name});")
    for port in kernel.outputs:
        kind = "int8_t" if port.is_status else real
        lines.append(f"{kind} *{port.name} = malloc(n * {port.size} * sizeof({kind}));")
        lines.append(f"if ({port.name} == NULL) exit(3);")
        writes.append(f"write_block(out, {port.name}, n * {port.size} * sizeof({kind}));")
    ports = [*kernel.inputs, *kernel.outputs]
    if manner == "batch":
        lines.append(f"{call}_batch_f{bits}(n, {', '.join(p.name for p in ports)});")
    elif manner == "one":
        arguments = [f"{p.name}[i]" if p.shape == () else f"{p.name} + {p.size} * i" for p in kernel.inputs]
        arguments += [f"{p.name} + {p.size} * i" for p in kernel.outputs]
        lines.append(f"for (size_t i = 0; i < n; ++i) {call}_f{bits}({', '.join(arguments)});")
    else:
        width = [1 if p.is_status else bits // 8 for p in ports]
        gap = 2 if manner == "spread" else 1
        way = -1 if manner == "backwards" else 1
        if manner == "spread":
            lines += [
                f"{p.name} = spread({p.name}, n * {p.size}, {w});" for p, w in zip(ports, width, strict=True)
            ]
            writes = [
                f"{p.name} = gathered({p.name}, n * {p.size}, {w});"
                for p, w in list(zip(ports, width, strict=True))[len(kernel.inputs) :]
            ] + writes
        steps = [str(way * gap * p.size * w) for p, w in zip(ports, width, strict=True)]
        for port, w in zip(ports, width, strict=True):
            for axis in range(len(port.shape)):
                steps.append(str(gap * w * int(np.prod(port.shape[axis + 1 :]))))
        last = "(n ? n - 1 : 0)" if manner == "backwards" else "0"
        starts = [f"(char *)({p.name} + {last} * {p.size})" for p in ports]
        lines.append(f"char *args[] = {{{', '.join(starts)}}};")
        lines.append(f"const ptrdiff_t dimensions[] = {{(ptrdiff_t)n}}, steps[] = {{{', '.join(steps)}}};")
        lines.append(f"{call}_loop_f{bits}_baseline(args, dimensions, steps, NULL);")
    body = "\n  ".join([*lines, *frees, *writes])
    return f"static void {name}_{bits}_{manner}(FILE *in, FILE *out) {{\n  {body}\n}}\n"


@pytest.fixture(scope="module")
def drivers(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The driver of a module, compiled when it is first asked for."""
    folder = tmp_path_factory.mktemp("sanitized")
    (folder / "probe.c").write_text("int main(void) { return 0; }\n")
    probe = [compiler, *SANITIZERS, str(folder / "probe.c"), "-o", str(folder / "probe")]
    if subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip(f"{compiler} has no address and undefined-behaviour sanitizers")
    if subprocess.run([folder / "probe"], capture_output=True, check=False).returncode:
        pytest.skip("programs with the address sanitizer do not run here")
    return cache(partial(compile_driver, compiler, folder))


def compile_driver(compiler: str, folder: Path, module: str) -> Path:
    names = sorted(name for name, kernel in GENERATED.items() if kernel.module == module)
    kinds = [(name, bits, manner) for name in names for bits in (64, 32) for manner in MANNERS]
    declarations = [
        f"void {module}_{name}_loop_f{bits}_baseline(char **, const ptrdiff_t *, const ptrdiff_t *, void *);"
        for name, bits, manner in kinds
        if manner == "loop"  # one of three that call it
    ]
    calls = [
        f'  if (strcmp(words[1], "{name}") == 0) {name}_{bits}_{manner}(in, out);'
        for name, bits, manner in kinds
    ]
    text = DRIVER.format(
        includes=f'#include "{module}.h"',
        declarations="\n".join(declarations),
        functions="\n".join(function(*kind) for kind in kinds),
        calls="\n".join(calls),
    )
    source = folder / f"{module}_driver.c"
    source.write_text(text)
    loops = C_FOLDER.parent / "gufunc" / f"{module}_loops.c"
    sources = [(file, C_WARNINGS) for file in (source, C_FOLDER / f"{module}.c")]
    sources += [(loops, ["-std=c11", "-fopenmp-simd", f"-DREAL_BITS={bits}"]) for bits in (64, 32)]
    objects = []
    for number, (file, standard) in enumerate(sources):
        objects.append(folder / f"{file.stem}_{number}.o")
        command = [compiler, *standard, *SANITIZERS, "-I", C_FOLDER, "-c", file, "-o", objects[-1]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    driver = folder / f"{module}_driver"
    subprocess.run([compiler, *SANITIZERS, *objects, "-o", driver, "-lm"], check=True)
    return driver


def sanitized(command: list[str | Path]) -> None:
    """Run a program in which the sanitizers must find nothing."""
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if "LeakSanitizer has encountered a fatal error" in done.stderr:  # it cannot trace inside some containers
        environment["ASAN_OPTIONS"] = "detect_leaks=0"
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def hostile(rng: np.random.Generator, size: int, bits: int) -> np.ndarray:
    """Return numbers of usual size, and among them, more and more, those that are none, nothing, or far too large."""
    info = np.finfo(f"f{bits // 8}")
    odd = [
        np.nan,
        np.inf,
        -np.inf,
        0,
        -0.0,
        1,
        -1,
        np.pi,
        info.max,
        -info.max,
        info.tiny,
        info.smallest_subnormal,
        info.eps,
    ]
    usual = rng.normal(size=size) * rng.choice([1e-30, 1e-8, 1, 1, 1e3, 1e30], size)
    return np.where(rng.random(size) < np.linspace(0, 1, size), rng.choice(odd, size), usual).astype(
        f"f{bits // 8}"
    )


QUICK = {"axis", "rotations"}  # matrices and scalars, statuses, trigonometric and usual cases


@pytest.mark.thorough
@pytest.mark.quick("axis_angle_from_matrix")
@of_kernels(GENERATED, slow=lambda name: MODULE_OF[name] not in QUICK)
def test_sanitizers_find_nothing_and_results_are_right(
    drivers: Callable[[str], Path], name: str, tmp_path: Path
) -> None:
    kernel, kinds = GENERATED[name], [(bits, manner) for bits in (64, 32) for manner in MANNERS]
    with open(tmp_path / "in", "wb") as file:
        for bits, _ in kinds:
            inputs = expected(name, bits).inputs
            rows = np.concatenate([np.arange(len(inputs[0])), [0, 1, 2]])  # no multiple of a block
            file.write(np.uint64(len(rows)).tobytes())
            for array in inputs:
                file.write(array[rows].tobytes())
    sanitized([drivers(kernel.module), name, tmp_path / "in", tmp_path / "out"])
    content = (tmp_path / "out").read_bytes()
    for bits, _ in kinds:
        results = []
        for port in kernel.outputs:
            kind = np.dtype(np.int8 if port.is_status else f"f{bits // 8}")
            size = len(rows) * port.size * kind.itemsize
            results.append(np.frombuffer(content[:size], kind).reshape(len(rows), *port.shape))
            content = content[size:]
        expected(name, bits).check(tuple(results), rows)
    assert content == b""


@pytest.mark.thorough
@of_kernels(GENERATED, slow=lambda name: name != "solve_axis")
def test_sanitizers_find_nothing_whatever_the_numbers_are(
    drivers: Callable[[str], Path], name: str, tmp_path: Path
) -> None:
    kernel, kinds = GENERATED[name], [(bits, manner) for bits in (64, 32) for manner in MANNERS]
    rng = np.random.default_rng([17, *name.encode()])
    driver = drivers(kernel.module)
    for rows in (0, 1, 333):
        with open(tmp_path / "in", "wb") as file:
            for bits, _ in kinds:
                file.write(np.uint64(rows).tobytes())
                for port in kernel.inputs:
                    file.write(hostile(rng, rows * port.size, bits).tobytes())
        sanitized([driver, name, tmp_path / "in", tmp_path / "out"])


@pytest.mark.parametrize("module", C_MODULES)
def test_emitted_c_allocates_nothing_and_has_no_globals(module: str) -> None:
    """So it runs on a controller: nothing but functions, constants and libm."""
    text = re.sub(r"/\*.*?\*/", "", (C_FOLDER / f"{module}.c").read_text(), flags=re.S)
    assert not re.search(r"\b(malloc|calloc|realloc|free|printf|static\s+(?!inline|const)\w+)\b", text)
    included = set(re.findall(r"#include [<\"](\S+)[>\"]", text))
    assert included <= {f"{module}.c", f"{module}.h", "float.h", "math.h", "string.h"}
    outside = re.sub(r"\{[^{}]*\}", "{}", text)
    outside = re.sub(r"\{[^{}]*\}", "{}", outside)
    assert "=" not in re.sub(r"#.*", "", outside)


@pytest.mark.parametrize("module", C_MODULES)
def test_header_serves_cxx_and_stands_alone(module: str, compiler: str, tmp_path: Path) -> None:
    source = tmp_path / "alone.c"
    source.write_text(f'#include "{module}.h"\n#include "{module}.h"\nint main(void) {{ return 0; }}\n')
    for language in ("c", "c++"):
        standard = "-std=c99" if language == "c" else "-std=c++11"
        flags = [standard, "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only", "-x", language]
        command = [compiler, *flags, "-I", str(C_FOLDER), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if language == "c++" and "cc1plus" in done.stderr:
            pytest.skip("the compiler has no C++")
        assert done.returncode == 0, done.stderr
