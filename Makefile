# make demo   opens the demo scene from this checkout
# make test   installs what the tests need and runs them all
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Real scenes take minutes; the compiled run is enough for them.
KERNEL_TESTS := tests/decode tests/raster tests/test_lanes.py --ignore tests/raster/test_real_scenes.py

.PHONY: demo test check install-dev clean

demo: $(VENV)/installed
	@$(BIN)/tsplat

test: install-dev
	scripts/system_packages.sh
	$(MAKE) --no-print-directory check
	$(BIN)/python -m pytest -m 'not e2e'
	$(BIN)/python -m pytest -m e2e --durations 5
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest $(KERNEL_TESTS)
	NUMBA_BOUNDSCHECK=1 $(BIN)/python -m pytest $(KERNEL_TESTS) tests/encode tests/edit tests/lod

check: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

install-dev: $(VENV)/installed-dev

# Debian packages the venv module apart from Python itself.
$(VENV)/bin/pip:
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || scripts/system_packages.sh python3-venv
	@$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml $(VENV)/bin/pip
	@$(BIN)/pip install -qq --disable-pip-version-check -e .
	@touch $@

$(VENV)/installed-dev: pyproject.toml $(VENV)/bin/pip
	@$(BIN)/pip install -qq --disable-pip-version-check -e '.[dev]'
	@touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache
