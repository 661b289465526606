# `make run` and `make test` need Python >= 3.11, pip and git only: each makes the virtual
# environment if there is none, and brings it up to date when the lock changes. `make run` installs
# what flies, `make test` all.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
QUIETLY := install --quiet --disable-pip-version-check
PIP := $(BIN)/python -m pip $(QUIETLY)
FLOWER := $(VENV)/flower
BASE := $(VENV)/.base
READY := $(VENV)/.ready

.PHONY: run test test-fast test-flower check docs clean

run: $(BASE)
	$(BIN)/aerofed run
	@echo 'Now ". $(BIN)/activate", and aerofed is a command: aerofed --help'

# In three processes, also on two cores: where one waits for a vehicle or a process, another computes.
# A file's tests stay together: they share what they have flown. tests/conftest.py has the order.
# Draws that are marked `again` are left to the nightly job.
test: $(READY)
	$(BIN)/python -m pytest @tests/in-parallel

# A minute and a half: without whole runs, and without what needs more than a clone brings.
test-fast: $(READY)
	$(BIN)/python -m pytest @tests/in-parallel -m "not slow and not real and not again"

# Flower asks for other versions of libraries than the lock has: they lie over those of $(VENV), in
# an environment of its own.
test-flower: $(READY)
	$(PYTHON) -m venv $(FLOWER)
	$(BIN)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))" \
		> $$($(FLOWER)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/below.pth
	$(FLOWER)/bin/python -m pip $(QUIETLY) 'flwr>=1.41'
	$(FLOWER)/bin/python -m pytest tests/examples/test_flower.py tests/examples/test_flower_client.py

# What CI checks beside the tests.
check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/generate.py --check

# The documentation as a site, in build/site.
docs: $(BASE)
	$(PIP) --constraint requirements.lock --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# An environment with the newest pip, which installs in two thirds of the time of the one that comes
# with Python 3.11; that one is unpacked only where Python itself has no pip to fetch another with.
define new_environment
	$(PYTHON) -m venv --without-pip $(VENV)
	$(PYTHON) -m pip --python $(BIN)/python $(QUIETLY) --no-compile --upgrade pip 2>/dev/null \
		|| $(BIN)/python -m ensurepip > /dev/null
endef

# The libraries are compiled while pip fetches; where that fails, the installation says why.
define fetch_and_compile
	$(PYTHON) -c 'import tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
		print(*project["dependencies"], sep="\n")' > $(VENV)/dependencies.txt
	nice -n 19 $(PYTHON) -c 'from native import building; building.build_missing()' 2> /dev/null & \
		$(PIP) --no-compile --constraint requirements.lock --requirement $(VENV)/dependencies.txt; \
		fetched=$$?; wait; exit $$fetched
endef

# What flies the quick start, and what tests need beside it.
$(BASE): pyproject.toml requirements.lock
	$(new_environment)
	$(fetch_and_compile)
	$(PIP) --no-compile --constraint requirements.lock --editable .
	touch $@

$(READY): pyproject.toml requirements.lock
	$(new_environment)
	$(fetch_and_compile)
	$(PIP) --constraint requirements.lock --editable '.[dev]'
	touch $(BASE) $@

clean:
	rm -rf $(VENV)
