# Everything that sets up and checks the project. Python 3.11 or newer and make are all that is needed:
# `make demo` and `make test` create .venv and install what they use.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
ALL_INSTALLED := $(VENV)/.installed-all
LIVE_INSTALLED := $(VENV)/.installed-live
# The package as it is installed, as links: what the type checker and the import linter read.
TREE := build/tree
# What tests import from their own folder or another's by its bare name.
HELPERS := $(filter-out %/conftest.py,$(wildcard tests/*/[!t]*.py tests/calib/joint_box/[!t]*.py))
EXTRAS ?= dev,docs,cad,models-test,live
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable

.PHONY: demo guide-demo test clients mutants lint format docs outputs walk schemas pictures printables dist docker clean

# The main job without hardware: print files, three simulated robots and their logs, three calibrations.
demo: $(INSTALLED)
	$(BIN)/make-target demo/box
	$(BIN)/simulate-fleet demo/robots --robots 3 --stops 12 --seed 1
	$(BIN)/fleet-calibrate demo/robots/*.mcap --target demo/box/target.json --out demo/calibration --truth

# A simulated robot to drive in a browser, and the guide beside it; Ctrl-C ends both.
guide-demo: $(LIVE_INSTALLED)
	$(BIN)/simulate-robot --serve --guide http://127.0.0.1:8787/ & robot=$$!; trap "kill $$robot" EXIT; \
	$(BIN)/guide ws://127.0.0.1:8765 --record demo/recordings --out demo/guided

# Without the CAD kernel and the readers of models (some 500 MB) their tests skip: `make test EXTRAS=dev`.
test: lint
	$(BIN)/python -m pytest -n 2 --dist worksteal

# Seeds bugs into a copy of the project and prints those that the tests do not notice: 40 that were once written down,
# then random changes to the four steps and the likelihood. Takes half an hour and more.
mutants: $(ALL_INSTALLED)
	$(BIN)/python tests/mutants/run.py
	$(BIN)/python tests/mutants/run.py --sampled 3

lint: $(ALL_INSTALLED) $(TREE)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	cd $(TREE) && $(CURDIR)/$(BIN)/mypy --config-file $(CURDIR)/pyproject.toml
	cd $(TREE) && PYTHONPATH=. $(CURDIR)/$(BIN)/lint-imports $(CURDIR)/pyproject.toml

format: $(ALL_INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Files opened in the programs that they are for, installed from Debian where this user may, and from PyPI; the tests
# say what is missing.
CLIENTS := prusa-slicer libreoffice-calc liburdfdom-tools libxml2-utils blender libsdformat-dev g++ pkg-config
clients: $(ALL_INSTALLED)
	-test "$$(id -u)" != 0 || { apt-get update -qq && apt-get install -y -qq --no-install-recommends $(CLIENTS); }
	-$(INSTALL:--editable=) pandas yourdfpy
	$(BIN)/python -m pytest tests/clients

# The documentation, strict: a dead link fails. The pages are build/docs/*.html.
docs: $(ALL_INSTALLED) $(TREE)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# The default box's sheets and landmark table, as they are kept in the repository.
printables: $(INSTALLED)
	$(BIN)/make-target printables

# The source distribution, and the wheel from it: nothing that lies about in build/ gets in.
dist: $(ALL_INSTALLED)
	rm -rf dist
	$(BIN)/python -m build --no-isolation --config-setting compile=no --outdir dist .

docker:
	docker build --tag boxcal .

# What README's and the tutorial's commands print, written into the pages.
outputs: $(INSTALLED)
	$(BIN)/python docs/site/outputs.py

# The stranger's walk: all commands of README and tutorial in a fresh clone and a fresh environment.
walk:
	PYTHON=$(PYTHON) tests/walk/walk

# Pictures of the tutorial, and of the first screen of a report of the demo.
pictures: demo
	$(BIN)/python docs/site/tutorial_pictures.py
	$(BIN)/python docs/site/report_picture.py

# JSON Schemas of the files that are written, as they are kept in the repository.
schemas: $(INSTALLED)
	$(BIN)/boxcal schemas docs/schemas

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed: make PYTHON=python3.11 ...") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) '.[report]'
	$(BIN)/python -m boxcal.calib.likelihood.compiled.compilation
	touch $(INSTALLED)

$(ALL_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[$(EXTRAS)]'
	touch $(ALL_INSTALLED)

$(LIVE_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[report,live]'
	touch $(LIVE_INSTALLED)

$(TREE): Makefile $(wildcard boxcal/*.py) $(HELPERS)
	mkdir -p $(TREE)/boxcal
	cd $(TREE)/boxcal && ln -sfn ../../../target target && ln -sfn ../../../detect detect && ln -sfn ../../../calib calib
	cd $(TREE)/boxcal && for file in ../../../boxcal/*.py ../../../boxcal/py.typed; do ln -sfn $$file .; done
	cd $(TREE) && ln -sfn ../../benchmarks benchmarks && ln -sfn ../../tests tests
	rm -rf $(TREE)/helpers && mkdir $(TREE)/helpers
	cd $(TREE)/helpers && for file in $(HELPERS); do ln -s ../../../$$file .; done
	touch $(TREE)

clean:
	rm -rf demo build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
