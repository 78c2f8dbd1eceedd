# Two commands do all the set-up: `make run` and `make test`.
PYTHON ?= python3.11
CASE   ?= cases/quickstart.toml
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e
# what the gmsh wheel loads at import and Debian's slim images lack
GMSH_LIBRARIES := libGLU.so.1 libGL.so.1 libXrender.so.1 libXcursor.so.1 libXft.so.2 libXinerama.so.1 libXfixes.so.3 libgomp.so.1
GMSH_PACKAGES  := libglu1-mesa libgl1 libxrender1 libxcursor1 libxft2 libxinerama1 libxfixes3 libgomp1

# installed without bytecode: what is imported is compiled once, then loaded by every process of the tests
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help run test laws bench stability setup lint sweep docs pictures dist clean
help:
	@echo "make run      set up, and simulate a first scene (CASE=other.toml)"
	@echo "make test     set up, and run the tests"
	@echo "make sweep    torque against current"
	@echo "make bench    measured against other programs"
	@echo "make stability hard scenes, kills, threads, random scenes, tests left out of make test (an hour)"
	@echo "make docs     documentation as HTML"
	@echo "make pictures draw the pictures of docs/ that are older than what they show (PICTURES=all: every one)"
	@echo "make lint     style and types"
	@echo "make dist     wheel and source distribution"
	@echo "make clean    remove what was set up, and runs"
run: setup ; @$(BIN)/emclutch run $(CASE)
test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile --max-worker-restart 0 --durations=30
	@$(BIN)/python tests/project/size_table.py
laws: ; @$(PYTHON) tests/project/laws.py
bench: setup ; $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]' && $(BIN)/python tests/benchmarks/bench.py
stability: setup ; $(BIN)/python tests/hard/all_parts.py runs/stability
sweep: setup ; $(BIN)/emclutch sweep cases/current_to_torque.toml
lint: setup ; $(BIN)/ruff check . && $(BIN)/mypy
docs: setup ; $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]' && $(BIN)/python -m sphinx -q -W --keep-going -n docs docs/_build/html
pictures: setup ; $(BIN)/python tests/project/pictures.py $(PICTURES)
dist: setup ; $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt build && $(BIN)/python -m build
clean: ; rm -rf $(VENV) runs build dist docs/_build .pytest_cache .mypy_cache .ruff_cache; find . -name __pycache__ -prune -exec rm -rf {} +
setup: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" sh .ci/system-libraries "$(GMSH_LIBRARIES)" "$(GMSH_PACKAGES)"
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) not found: apt-get install python3.11 python3.11-venv, or make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@echo "installing about 90 packages, and compiling what the quickstart needs: some minutes, and nothing is printed meanwhile"
	$(PIP) '.[fast]'
# two processes compile while pip installs the rest; what they miss, the first run compiles
	@$(BIN)/python -m emclutch.simulation.kernel_warm_up cases/quickstart.toml >$(VENV)/compiled.log 2>&1 & \
	$(PIP) '.[dev,fast,solid,dask,sensitivity,xarray]' && { wait; touch $@; echo "set up; the program is $(BIN)/emclutch"; }
