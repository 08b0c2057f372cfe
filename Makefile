# make run   install into .venv, run the service on the built-in room, write a picture of the result
# make warm-up  compile the kernels
# make test  install what the tests need, compile the kernels, run the tests
# make lint  formatter, linter, type checker, generated docs
# make collect  import all tests; as a side effect Python compiles them once, which each worker would do
# make docs  build the site of docs/ into build/site, strictly
# make docs-update  write the generated parts of the documents
# make bench measure the figures of the README and store them as JSON; BATCH=1 runs lockstep rows as Ray
#            tasks, BATCH=HOST:PORT on a cluster
# make lock  write requirements/*.lock from pyproject.toml; UPGRADE=1 takes the newest versions
# make resolve  check that pyproject.toml and the locks resolve on PyPI, for every Python and platform
# make package  build wheel and sdist, install each into a fresh environment, run every command there
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= runs/room
LOCKS := $(wildcard requirements/*.*)
GENERATED := $(addprefix docs/,architecture.md cameras.md cli.md wire.md)  # the parts between [[[cog and [[[end]]]
UV_VERSION := 0.13.9
UV := build/uv/bin/uv

AGAIN := $(BIN)/python -m tests.run_again

export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
# let the first process that imports a package write its bytecode (see --no-compile in requirements/install.py)
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run warm-up test collect lint docs docs-update bench lock resolve package clean look-again

run: $(VENV)/.installed
	$(BIN)/hsslam-serve --source synth:room --frames 300 --viewer none --out $(OUT)
	$(BIN)/python -m hsslam_services.commands.maps.picture $(OUT)

warm-up: $(VENV)/.installed-dev
	$(BIN)/hsslam-serve warm-up

# Shared machines stall: a test that fails (exit code 1) runs again by itself. The log names it; if it fails again, so does make.
test: warm-up
	$(BIN)/pytest --cache-clear -m 'not long and not alone' --numprocesses 4 --dist loadgroup --no-loadscope-reorder || { [ $$? -eq 1 ] && $(AGAIN); }
	$(BIN)/pytest --cache-clear -m 'alone and not long' $(shell grep --recursive --files-with-matches 'mark\.alone\b' tests --include 'test_*.py') \
		|| { [ $$? -eq 1 ] && $(AGAIN); }

collect: $(VENV)/.installed-dev
	@mkdir -p build
	$(BIN)/pytest --collect-only -qq -m 'not long' --no-header > build/collected.txt || { cat build/collected.txt; exit 1; }

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyrefly check --python-interpreter-path $(BIN)/python
	$(BIN)/cog --check $(GENERATED)

# no --quiet, because it hides warnings from --strict; NO_MKDOCS_2_WARNING hides an advertisement of the theme
docs: $(VENV)/.installed-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --config-file docs/site/mkdocs.yml

# writes the parts on topics, processes and commands from the code
docs-update: $(VENV)/.installed-dev
	$(BIN)/cog -r $(GENERATED)

bench: $(VENV)/.installed
	$(BIN)/python -m hsslam_bench $(if $(BATCH),--address $(patsubst 1,local,$(BATCH)))

package:
	.ci/package $(PYTHON)

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis

# TORCH=cpu|cuda chooses PyTorch's build, else the machine does; if it is set, the installer runs again
$(VENV)/.installed: pyproject.toml $(LOCKS) $(if $(TORCH),look-again)
	$(PYTHON) requirements/install.py --venv $(VENV) --editable
	touch $@

$(VENV)/.installed-dev: pyproject.toml $(LOCKS) $(if $(TORCH),look-again)
	$(PYTHON) requirements/install.py --venv $(VENV) --editable --dev
	touch $@ $(VENV)/.installed

lock: $(UV)
	$(PYTHON) requirements/lock.py $(UV) $(if $(UPGRADE),--upgrade)

resolve: $(UV)
	$(PYTHON) .ci/resolve.py $(UV)

$(UV): Makefile
	$(PYTHON) -m venv --clear build/uv
	build/uv/bin/pip install --quiet uv==$(UV_VERSION)
	touch $@
