# All tasks of this repository. `make` lists them; the two to know are `make demo` and `make test`.
PYTHON ?= python3
CC     ?= cc
JOBS   ?= 2
BIN    := .venv/bin
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_ROOT_USER_ACTION := ignore
# pip compiles nothing to byte code: for all packages that takes longer than to unpack them, and most is never imported.
# Python compiles a module when it is first imported, and must be allowed to keep the result.
export PYTHONDONTWRITEBYTECODE :=
INSTALL := $(BIN)/python -m pip install -qq --no-compile --no-build-isolation

# The sources of the compiled kernels: when one changes, the package is installed again.
BUILT_FROM := pyproject.toml CMakeLists.txt $(wildcard generated/c/*.[ch] generated/gufunc/*.[ch])

PYTEST     := -m pytest -n $(JOBS) --dist loadgroup -m
TESTS      ?= not slow and not thorough

.DEFAULT_GOAL := help
.PHONY: help demo open test test-processors test-thorough test-slow torture fuzz answers kernels check check-kernels check-style check-types check-imports check-c notebooks bench study certify mutants docs docs-links pictures wheel pythons clean

help: ## list these commands
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1|\2/p' Makefile | awk -F'|' '{printf "  make %-15s %s\n", $$1, $$2}'

demo: .venv/all ## a real telescope: fit, compare, diagnose, correct, emit C, write a report
	@$(BIN)/python examples/demo.py

open: .venv/all ## the workbench, on the real telescope: a page on which effects are added and the error falls
	@$(BIN)/rodgen open examples/machines/mount/machine.toml examples/machines/mount/mmt_2021.csv

test: .venv/test ## run the tests (PROCESSOR=prescott: as on that one of tests/processors.py; TESTS="not slow": thorough ones, too)
	$(BIN)/python $(if $(PROCESSOR),tests/processors.py $(PROCESSOR)) $(PYTEST) "$(TESTS)"

test-processors: .venv/test ## run the tests as on each processor of tests/processors.py: other linear algebra, other loops
	$(BIN)/python tests/processors.py all $(PYTEST) "$(TESTS)"

test-thorough: .venv/test ## run the tests that take more than half a second each, six minutes in all
	@$(MAKE) test TESTS="thorough and not slow"

test-slow: .venv/test-slow ## run the tests that take longer: grids of cases, long statistics, sanitizers of all kernels
	$(BIN)/python $(PYTEST) slow

torture: .venv/test ## let each file operation of commands fail in turn, or be where Ctrl-C is pressed
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal tests/test_torture.py

fuzz: .venv/test ## run commands on files and arguments that are changed at random, for ten minutes, with a new seed each day (FUZZ_SEED=...)
	$(BIN)/python tests/fuzz.py $(if $(FUZZ_SEED),--seed $(FUZZ_SEED)) $(if $(FUZZ_SECONDS),--seconds $(FUZZ_SECONDS))

answers: .venv/study ## compare what the product says with the frozen answers (ACCEPT=1 freezes them, ALL=1 lists all, ONLY=diagnoses: one part)
	$(BIN)/python answers/run.py -j $(JOBS) $(if $(ONLY),--only $(ONLY)) $(if $(CASE),--case "$(CASE)") $(if $(ALL),--all) $(if $(ACCEPT),--accept)

kernels: .venv/all ## regenerate generated/ from derivation/
	$(BIN)/rodgen kernels
	@echo "generated/ is up to date."

check: check-kernels check-style check-types check-imports check-c ## check that generated files are fresh, lint, types, imports, and that the C compiles without warnings

check-kernels: .venv/all
	$(BIN)/rodgen kernels --check

check-style: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@test -x .ci/run || { echo ".ci/run is not executable: chmod +x .ci/run"; exit 1; }

check-types: .venv/dev
	$(BIN)/mypy

# The floors, in pyproject.toml: no import upward and no cycle, imports inside functions included.
check-imports: .venv/dev ## check that no import leads upward and none is circular, and what else tests/lints.py says of the whole
	$(BIN)/lint-imports --no-cache
	$(BIN)/python -m pytest -q tests/lints.py

# With each installed compiler: the C for users as strict C99, the NumPy extension as C11. Of its three variants one is
# compiled, with what a compiler sees when it optimises; the others, the same lines with other types, are only read.
# Clang warns about loops that it does not vectorise; that is not an error.
check-c: .venv/all
	@found=; includes=$$($(BIN)/python -c 'import numpy, sysconfig; print("-isystem", sysconfig.get_path("include"), "-isystem", repr(numpy.get_include()))'); \
	for cc in "$(CC)" clang; do \
	    command -v "$$cc" > /dev/null && echo 'int main(void) { return 0; }' | "$$cc" -x c - -o /dev/null 2> /dev/null || continue; \
	    found=yes; \
	    for file in generated/c/*.c; do \
	        echo "$$cc -std=c99 -Wall -Wextra -pedantic -Werror $$file"; \
	        "$$cc" -std=c99 -O2 -Wall -Wextra -pedantic -Werror -c "$$file" -o /dev/null || exit 1; \
	    done; \
	    for file in generated/gufunc/*.c; do \
	        echo "$$cc -std=c11 -Wall -Wextra -Werror $$file"; \
	        for variant in "-O1 -DREAL_BITS=64" "-fsyntax-only -DREAL_BITS=32" "-fsyntax-only -DROW_BY_ROW"; do \
	            eval "$$cc -std=c11 -Wall -Wextra -Werror -Wno-pass-failed -fopenmp-simd $$variant $$includes -c $$file -o /dev/null" || exit 1; \
	        done; \
	    done; \
	done; \
	test -n "$$found" || echo "No C compiler: the generated C is not checked."

docs: .venv/docs ## build the documentation site into build/site; its links are checked, and warnings are errors
	@$(BIN)/python docs/site/build.py -j $(JOBS)

docs-links: .venv/docs ## check the links of the site to other sites, which needs a network
	@$(BIN)/python docs/site/build.py -j $(JOBS) --links

notebooks: .venv/notebooks ## execute the derivations into build/notebooks, as .ipynb
	@$(BIN)/python docs/site/notebooks.py -j $(JOBS)

bench: .venv/test-slow ## measure the speed, compared with other libraries and the limits of the hardware (ONLY=fits, axis, tricept, three_sps_s, robots, spatial, diagnose or workbench: one part)
	$(BIN)/python benchmarks/run.py $(if $(ONLY),--only $(ONLY))

study: .venv/study ## measure how often a diagnosis and a plan are right by two simulators (N=60 machines per group; ONLY=innocent, plan or wrong: one part)
	$(if $(filter plan wrong,$(ONLY)),,$(BIN)/python study/run.py -j $(JOBS) $(if $(N),-n $(N)) $(if $(ONLY),--only "$(ONLY)"))
	$(if $(filter plan wrong,$(ONLY)),,$(BIN)/python study/run.py -j $(JOBS) $(if $(N),-n $(N)) $(if $(ONLY),--only "$(ONLY)") --simulator physics)
	$(if $(filter-out plan,$(ONLY)),,$(BIN)/python study/plan.py $(if $(N),-n $(N)))
	$(if $(filter-out wrong,$(ONLY)),,$(BIN)/python study/wrong_files.py $(if $(N),-n $(N)))

certify: .venv/study ## bound the rounding errors of kernels for whole boxes of inputs, and write docs/science/certified.md
	$(BIN)/python study/certify.py -j $(JOBS)

mutants: .venv/mutants ## measure how many small faults in codegen, statistics and machines the tests find (N=60 places of each; hours)
	$(BIN)/python study/mutants.py map
	$(BIN)/python study/mutants.py run $(if $(N),-n $(N))
	$(BIN)/python study/mutants.py table

wheel: .venv/supply ## build the source distribution and a wheel into dist, with a bill of materials, and use both in clean environments
	$(BIN)/python supply/wheel.py

pythons: .venv/supply ## build and use wheels for Python 3.11 to 3.13 with NumPy 2.0 and the newest, by GCC and Clang; says what it skips
	$(BIN)/python supply/pythons.py

pictures: .venv/all ## redraw the pictures of the README and of docs/science/solver_method.md
	$(BIN)/python docs/make_pictures.py

clean: ## remove everything that make wrote
	rm -rf .venv build dist .pytest_cache .hypothesis .mypy_cache .ruff_cache

# One environment, and each target adds what it needs: .venv/EXTRA stands for the extras of that name and "all" in
# pyproject.toml. pip prints errors only. It installs packages while the extension is compiled, which is half the work; the
# extension is built in this environment, so that only changed files are compiled again.
.venv/all .venv/test .venv/test-slow .venv/study .venv/dev .venv/mutants .venv/supply .venv/notebooks .venv/docs: .venv/build-requires.txt $(BUILT_FROM)
	@echo "Building the kernels, and installing rodgen and what it needs into .venv (a minute the first time) ..."
	@$(BIN)/python supply/requirements.py all $(@F) > .venv/requirements.txt
	@$(INSTALL) --no-deps -e . & extension=$$!; \
	$(INSTALL) -r .venv/requirements.txt; packages=$$?; wait $$extension && exit $$packages
	@touch .venv/all $@

.venv/build-requires.txt: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null || { \
	    echo "rodgen needs Python 3.11 or later, and $(PYTHON) is `$(PYTHON) --version 2>&1 || :`; name another one: make PYTHON=python3.12"; exit 1; }
	@$(BIN)/python -c 'import pip' 2> /dev/null || $(PYTHON) -m venv --clear .venv
	@$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")' > $@
	@$(INSTALL) -r $@ || { rm $@; exit 1; }
	@$(BIN)/python -c 'from scikit_build_core.build import *; print(*get_requires_for_build_editable({}), sep="\n")' > .venv/cmake.txt
	@$(INSTALL) -r .venv/cmake.txt || { rm $@; exit 1; }
