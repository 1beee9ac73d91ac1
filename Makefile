# Everything happens in .venv; nothing outside this folder is touched.
PYTHON ?= python3
ROBOT ?= amouri2019
RESOLUTION ?= lowest-direct
VENV := .venv
BIN := $(VENV)/bin
RUST_SOURCES := $(shell find crates -name '*.rs' -o -name Cargo.toml) Cargo.toml Cargo.lock

.PHONY: study checks test test-all test-versions bench build campaign campaign-files clean lock

study: build ## the main job: the study of the built-in robot, or of ROBOT=my_robot.yaml
	@$(BIN)/bowstring study "$(ROBOT)"

build: $(VENV)/.built

$(VENV)/.tools: requirements/dev.lock
	@echo "== setting up $(VENV) (once)"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Bowstring needs Python 3.10 or newer")'
	@command -v cargo >/dev/null || { echo "Bowstring needs a Rust toolchain (1.89 or newer)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --progress-bar on -q --require-hashes -r requirements/dev.lock
	@touch $@

$(VENV)/.built: $(VENV)/.tools $(RUST_SOURCES) pyproject.toml
	@echo "== building the core (about a minute the first time)"
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --locked
	@touch $@

PYTEST := $(BIN)/python -m pytest -n auto --dist loadfile

checks: build
	cargo fmt --all --check
	cargo clippy --all-targets --locked -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: checks ## lints, types, and the tests that are quick
	cargo test -p bowstring-core --locked
	$(PYTEST) -m "not slow and not fem and not cad and not data"

test-all: checks ## the same with all tests: statistics, finite elements, solids, kills, data of others
	cargo test -p bowstring-core --locked -- --include-ignored
	$(PYTEST)

test-versions: build ## tests with the oldest versions allowed, or RESOLUTION=highest (needs uv)
	uv venv --quiet --allow-existing --python $(PYTHON) .venv-$(RESOLUTION)
	uv pip install --quiet --upgrade --python .venv-$(RESOLUTION) --resolution $(RESOLUTION) -r pyproject.toml
	uv pip install --quiet --python .venv-$(RESOLUTION) -r requirements/dev.in
	@echo $(abspath python) > $$(echo .venv-$(RESOLUTION)/lib/python3*/site-packages)/bowstring.pth
	.venv-$(RESOLUTION)/bin/python -m pytest -n auto --dist loadfile -W default $(TESTS)

bench: build .venv-peers/.tried ## our times beside those of other solvers
	-cargo bench -p bowstring-core --locked
	@$(BIN)/python -m benchmarks.run

.venv-peers/.tried: requirements/peers.in requirements/peers.lock
	@echo "== installing the peers (1.1 GB, once); one that fails is reported in the table"
	@test -d .venv-peers || $(PYTHON) -m venv .venv-peers
	@while read -r peer; do \
		echo "$$peer"; \
		.venv-peers/bin/python -m pip install -q -c requirements/peers.lock "$$peer" || true; \
	done < requirements/peers.in
	@touch $@

N ?= 100000
campaign: ## random solves by the million, each checked from the outside: make campaign N=1000000
	cargo run --release --locked -p bowstring-core --example campaign -- $(N)

campaign-files: build ## N more damaged files, then 100 killed commands; slow, resumable
	nice -n 10 $(BIN)/python -m campaign.files $(N)
	nice -n 10 $(BIN)/python -m campaign.kills 100

clean:
	rm -rf $(VENV) .venv-peers .venv-lowest-direct .venv-highest target

lock: ## renew the lock file (needs uv)
	uv pip compile --universal --python-version 3.10 --no-header --no-annotate --generate-hashes --no-emit-index-url --no-emit-find-links --extra cad pyproject.toml requirements/dev.in -o requirements/dev.lock
	uv pip compile --universal --python-version 3.10 --no-header --no-annotate requirements/peers.in -o requirements/peers.lock
