# epiline: everything a developer or a curious visitor needs. `make` alone lists the targets.

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
OUT    ?= build

.DEFAULT_GOAL := help
.PHONY: help build demo test lint bench anchors clean ci

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

$(VENV)/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group dev
	touch $@

build: $(VENV)/.ready ## build the extension into a private virtual environment
	$(BIN)/maturin develop --release --quiet

demo: build ## the whole system on a rendered rig: no camera, no download
	$(BIN)/epiline demo --output $(OUT)/demo

test: build ## every test: Rust, documentation examples, Python
	cargo test --workspace --quiet --no-fail-fast
	$(BIN)/pytest

lint: $(VENV)/.ready ## formatting, clippy, ruff, mypy --strict, the stub against the built module
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest epiline._core

bench: build ## speed against OpenCV in one run, answers compared
	$(BIN)/epiline bench

anchors: build ## accuracy and calibration figures on the real data in EPILINE_DATA
	$(BIN)/epiline evaluate $${EPILINE_DATA:-../shared/data}
	$(BIN)/python benchmarks/calibration_anchors.py

ci: test lint ## what .ci/run does

clean: ## remove what was built
	rm -rf $(VENV) $(OUT) target
