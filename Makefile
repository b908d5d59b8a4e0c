# Requires only python3 (3.11 or later) and make; creates .venv.
# PYTHON=python3.12 make test   creates .venv with another interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= results/reproduce
HEAVE ?= results/heave_step
SEEN ?= results/pitch_sine
SITE ?= build/site
# make mutants MUTANTS="model --token 20": options of python -m tools.mutants
MUTANTS ?= --report results/mutants/report
# a worker for each processor: a further one would collect and import everything once more
TESTS := $(BIN)/python -m pytest --numprocesses=logical --dist=loadfile
# Of what is installed, the demo imports a small part, which is compiled then and kept; tests import most of it.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
COMPILED = $(BIN)/python -W ignore -m compileall -q -q -j 0 $(VENV)/lib || true
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo view test coverage check bench evidence mutants format docs figures lower-bounds dist release-check clean
help:
	@echo "make demo      build the FMUs, reproduce the paper (files in $(OUT)), run a closed loop (in $(HEAVE))"
	@echo "make view      run a closed loop and show its motion in the browser (page in $(SEEN))"
	@echo "make test      run the tests"
	@echo "make coverage  run them with branch coverage, which must stay above 95 % in model; takes half as long again"
	@echo "make check     check formatting, ruff, mypy, import directions"
	@echo "make bench     measure speed, as ratios"
	@echo "make evidence  run the slow tests: Pinocchio, long runs, long fuzz, other importers and processors"
	@echo "make mutants   run the tests on copies of the sources with small bugs and count those they detect"
	@echo "make format    format the code"
	@echo "make docs      build the documentation site, which needs no network, in $(SITE)"
	@echo "make figures   redraw the pictures of README and docs, rewrite the outputs in the tutorial"
	@echo "make dist      build sdist and wheel in dist/, after a test that installs them"
	@echo "make release-check  install sdist and wheel of a clean clone with every Python, run README there, list all licences"
	@echo "make lower-bounds  run the tests with the oldest versions that pyproject.toml allows"

demo: $(VENV)/kernel
	$(BIN)/gough-stewart reproduce --report --out $(OUT)
	$(BIN)/gough-stewart run heave_step --plant fmu3 --report --figures --out $(HEAVE)
	@echo "open $(OUT)/report.html and $(HEAVE)/report.html in a browser to see both motions, or try make view"

view: $(VENV)/kernel
	$(BIN)/gough-stewart run pitch_sine --plant fmu3 --out $(SEEN)
	$(BIN)/gough-stewart view $(SEEN) --out $(SEEN)/report.html --open

test: $(VENV)/dev $(VENV)/kernel
	$(TESTS)

coverage: $(VENV)/dev $(VENV)/kernel
	$(TESTS) --cov --cov-report=term
	$(BIN)/python -m coverage report --include='*/model/*' --fail-under=95 --format=total

check: $(VENV)/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# each runs, whatever the ones before it missed; what missed its figure is listed at the end
BENCHMARKS := start first_minutes run fmu machine controller coupled loop stream lanes ensemble environments workspace view identify
bench: $(VENV)/bench
	@missed=""; for each in $(BENCHMARKS); do \
		PYTHONPATH=. $(BIN)/python benchmarks/$$each.py || missed="$$missed $$each"; \
	done; \
	if [ -n "$$missed" ]; then echo "missed their figures or failed:$$missed"; exit 1; fi

evidence: $(VENV)/evidence
	$(BIN)/python -m pytest -m evidence -s
	HYPOTHESIS_PROFILE=evidence $(BIN)/python -m pytest -q tests/model

mutants: $(VENV)/dev results/mutants/tests.json
	$(BIN)/python -m tools.mutants $(MUTANTS)
# which tests run a line, at the commit that is checked out; made once, until it is deleted
results/mutants/tests.json: | $(VENV)/dev
	$(BIN)/python -m tools.mutants --map --jobs 2

format: $(VENV)/dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The variable suppresses a notice of the theme.
docs: $(VENV)/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --site-dir "$$($(BIN)/python -c 'import os, sys; print(os.path.abspath(sys.argv[1]))' "$(SITE)")"
	@echo "open $(SITE)/index.html"

figures: $(VENV)/dev
	$(BIN)/python docs/figures/draw.py
	$(BIN)/python docs/figures/draw_loop.py
	$(BIN)/python docs/figures/draw_heave.py
	$(BIN)/python docs/figures/draw_paper.py
	$(BIN)/python docs/figures/draw_view.py
	$(BIN)/python docs/figures/draw_architecture.py
	$(BIN)/python docs/figures/draw_workspace.py
	$(BIN)/python docs/figures/draw_recorded.py
	$(BIN)/python docs/figures/draw_fastest.py
	$(BIN)/python docs/figures/draw_shares.py
	$(BIN)/python docs/figures/draw_ensemble.py
	$(BIN)/python docs/figures/draw_tolerance.py
	$(BIN)/python docs/figures/draw_machine.py
	$(BIN)/python -m tools.pages

dist: $(VENV)/dev
	$(BIN)/python -m pytest -q -m '' tests/evidence/test_install.py
	rm -rf build dist
	cd build_backend && $(abspath $(BIN))/python -c 'import os, prebuilt_wheel as b; os.chdir(".."); b.build_sdist("dist"); b.build_wheel("dist")'
	rm -rf build

release-check: $(VENV)/dev
	$(BIN)/python -m tools.release

lower-bounds:
	$(PYTHON) -m venv $(VENV)-lowest
	$(VENV)-lowest/bin/python -m pip install --quiet uv
	$(VENV)-lowest/bin/uv pip install --quiet --python $(VENV)-lowest/bin/python --resolution lowest-direct -e '.[dev]'
	@# old releases run with newer versions of their own dependencies: ignore their deprecation warnings
	$(VENV)-lowest/bin/python -m pytest -q --numprocesses=logical --dist=loadfile -W default::DeprecationWarning

clean:
	rm -rf $(VENV) $(VENV)-lowest results build dist *.egg-info

# Stamp files: each extra is installed again only if its dependencies change.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Python 3.11 or later is needed; this is " + sys.version.split()[0] + " (try PYTHON=python3.12 make ...)")'
	$(PYTHON) -m venv $(VENV)
$(VENV)/run: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[compile]'
	@touch $@
KERNEL_SOURCES := $(shell find model fmu_build -type f -not -path '*/__pycache__/*')
# The equations and their stepper as machine code for this machine; what else is compiled is compiled at first use and kept.
$(VENV)/kernel: $(VENV)/run $(KERNEL_SOURCES)
	$(BIN)/python -m gough_stewart.harness.prebuilt --only-kernel
	@touch $@
$(VENV)/dev: $(VENV)/run
	$(PIP) -e '.[dev]'
	@$(COMPILED)
	@touch $@
$(VENV)/docs: $(VENV)/run
	$(PIP) -e '.[docs]'
	@touch $@
$(VENV)/bench: $(VENV)/run
	$(PIP) -e '.[evidence]'
	@touch $@
$(VENV)/evidence: $(VENV)/dev
	$(PIP) -e '.[dev,evidence]'
	@$(COMPILED)
	@touch $@
