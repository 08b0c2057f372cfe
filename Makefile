# make run   install into .venv, run the main job on the built-in room, leave a picture of the result
# make test  install what the tests need, run them
# make lint  formatter, linter, type checker, generated docs
# make docs  build the site of docs/ into build/site, strictly
# make bench measure the table of the README and store it as JSON
# make package  build wheel and sdist, install each into a fresh environment, run it there
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= runs/room

export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
# a package is compiled by the first process that imports it (see --no-compile below), not by every one
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test lint docs bench package clean

run: $(VENV)/.installed
	$(BIN)/hsslam-serve --source synth:room --frames 300 --viewer none --out $(OUT)
	$(BIN)/python -m hsslam_services.commands.maps.picture $(OUT)

test: $(VENV)/.installed-dev
	$(BIN)/hsslam-serve warm-up
	$(BIN)/pytest -m 'not e2e' --numprocesses 2 --dist loadfile --no-loadscope-reorder
	$(BIN)/pytest -m e2e

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/python -m hsslam_proto.topic_table --check docs/architecture.md
	$(BIN)/python -m hsslam_proto.wire_doc --check docs/wire.md
	$(BIN)/python docs/site/source_table.py --check docs/cameras.md

# without --quiet, which hides warnings from --strict; NO_MKDOCS_2_WARNING: no advertisement of the theme
docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --config-file docs/site/mkdocs.yml

bench: $(VENV)/.installed
	$(BIN)/python -m hsslam_bench

package:
	.ci/package $(PYTHON)

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
	$(PYTHON) -m venv $(VENV)

# without --no-compile, pip compiles all of torch, numba and the others, and waits for it; Python compiles what it imports
$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]'
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[docs]'
	touch $@
