# Everything happens in .venv, .venv-* and target; outside this folder, only playground adds a target to Rust.
PYTHON ?= python3
ROBOT ?= amouri2019
RESOLUTION ?= lowest-direct
# of the extras, view and rerun are in no lock: viser holds rich below 15, rerun-sdk takes 170 MB
SMALL_EXTRAS := --extra excel --extra download --extra uncertainty --extra cluster --extra jax --extra gymnasium --extra rosbag --extra matlab
VENV := .venv
BIN := $(VENV)/bin
RUST_SOURCES := $(shell find crates/bowstring-rod crates/bowstring-core crates/bowstring-py -name '*.rs' -o -name Cargo.toml) Cargo.toml Cargo.lock

.PHONY: study checks core-tests rust-tests rust-slow-tests python-tests test test-slow test-all test-versions docs bench \
	build campaign campaign-files clean lock suite paper-figures playground test-playground wheel sdist check-wheel \
	check-sdist check-version

study: build ## the main job: the study of the built-in robot, or of ROBOT=my_robot.yaml
	@$(BIN)/bowstring study "$(ROBOT)"

build: $(VENV)/.built

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Bowstring needs Python 3.10 or newer")'
	@command -v cargo >/dev/null || { echo "Bowstring needs a Rust toolchain (1.89 or newer)" >&2; exit 1; }
	@echo "== setting up $(VENV) (once)"
	$(PYTHON) -m venv $(VENV)

# .installed-base is what the package needs; test (with the small extras), all (with cad) and docs come on
# top
$(VENV)/.installed-%: requirements/%.lock | $(BIN)/python
	$(BIN)/python -m pip install --progress-bar on -q --require-hashes -r $<
	@touch $@

# one pip at a time, also under make -j
$(VENV)/.installed-test: | $(VENV)/.built
$(VENV)/.installed-all: | $(VENV)/.installed-test
$(VENV)/.installed-docs: | $(VENV)/.built

$(VENV)/.built: $(VENV)/.installed-base $(RUST_SOURCES) pyproject.toml
	@echo "== compiling the core: two to four minutes on two cores the first time, because the rod is compiled for each"
	@echo "   kind of processor; half a minute after a change of the solvers"
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --locked
	@touch $@

# Each core has a process of pytest, so that more threads of linear algebra only wait for each other.
SLOW := slow or fem or cad or data
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal --durations=20

checks: build $(VENV)/.installed-test
	cargo fmt --all --check
	cargo clippy --all-targets --locked -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Unit tests check overflow and debug assertions. The others take the core as it was compiled for the package, because
# compiling it takes minutes.
UNIT_TESTS := cargo test -p bowstring-rod -p bowstring-core --lib --locked
CORE_TESTS := cargo test --release -p bowstring-core --test '*' --locked
FACE_TESTS := cargo test --release -p bowstring-c -p bowstring-wasm --locked
# Criterion runs each benchmark once as a test.
BENCHES_ONCE := cargo test --release -p bowstring-core --bench '*' --locked
CAMPAIGN := cargo run --release --locked -p bowstring-core --example campaign --

core-tests: ## compiles the tests of the core
	$(UNIT_TESTS) --no-run --quiet
	$(CORE_TESTS) --no-run --quiet
	$(FACE_TESTS) --no-run --quiet

rust-tests: core-tests
	$(UNIT_TESTS)
	$(CORE_TESTS)
	$(FACE_TESTS)
	MAKEFLAGS= cargo test --release -p bowstring-core --doc --locked

rust-slow-tests: core-tests
	$(CORE_TESTS) -- --ignored
	$(BENCHES_ONCE)
	rm -f target/campaign-small.txt
	$(CAMPAIGN) 500 target/campaign-small.txt

test: checks rust-tests ## lints, types, and the tests that are quick
	$(PYTEST) -m "not ($(SLOW))"

test-slow: checks rust-slow-tests $(VENV)/.installed-all ## the others: statistics, finite elements, solids, kills, data of others, small benchmarks of the core
	$(PYTEST) -m "$(SLOW)"

test-all: checks rust-tests rust-slow-tests python-tests ## all tests; with -j 2, those of Rust beside those of Python

python-tests: build $(VENV)/.installed-all
	$(PYTEST)

test-versions: build ## tests with the oldest versions allowed, or RESOLUTION=highest (needs uv)
	uv venv --quiet --allow-existing --python $(PYTHON) .venv-$(RESOLUTION)
	uv pip install --quiet --upgrade --python .venv-$(RESOLUTION) --resolution $(RESOLUTION) $(SMALL_EXTRAS) -r pyproject.toml
	uv pip install --quiet --python .venv-$(RESOLUTION) -r requirements/build.in -r requirements/dev.in
	@echo $(abspath python) > $$(echo .venv-$(RESOLUTION)/lib/python3*/site-packages)/bowstring.pth
	.venv-$(RESOLUTION)/bin/python -m pytest -n auto --dist worksteal -W default $(TESTS)

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

SHARED := $(abspath ../shared/data)
suite: build $(VENV)/.installed-test ## constant curvature and the rod on all public data sets; in BOWSTRING_DATA, ../shared/data, or downloaded
	@BOWSTRING_DATA="$${BOWSTRING_DATA:-$(wildcard $(SHARED))}" $(BIN)/bowstring suite

N ?= 100000
campaign: ## random solves by the million, each checked from the outside: make campaign N=1000000
	$(CAMPAIGN) $(N)

campaign-files: build $(VENV)/.installed-test ## N more damaged files, then 100 killed commands; slow, resumable
	nice -n 10 $(BIN)/python -m campaign.files $(N)
	nice -n 10 $(BIN)/python -m campaign.kills 100

docs: build ## the documentation site, in docs/_build/html
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11) and "the documentation needs Python 3.11 or newer")'
	@$(MAKE) --no-print-directory $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W --keep-going -q docs docs/_build/html
	@echo "Documentation: $(abspath docs/_build/html/index.html)"

# each in a target folder of its own, which cargo locks while it builds
WASM := target/wasm/wasm32-unknown-unknown/release/bowstring_wasm.wasm
BINDGEN := target/bindgen/release/bowstring-bindgen
WASM_SOURCES := $(shell find crates/bowstring-rod crates/bowstring-core/src crates/bowstring-compiled crates/bowstring-wasm -name '*.rs' -o -name Cargo.toml) \
	Cargo.toml Cargo.lock
WEB_SOURCES := $(shell find web/src -type f) web/index.html web/vite.config.ts python/bowstring/robot/builtin
PAGE := python/bowstring/cli/playground.html

playground: $(PAGE) ## the page, one file that a browser opens; the wheel and the documentation take it
	@echo "Playground: $(abspath $(PAGE)); show it with: bowstring playground"

web/.tools:
	@command -v npm >/dev/null || { echo "the playground needs Node.js 20 or newer with npm" >&2; exit 1; }
	@command -v cargo >/dev/null || { echo "the playground needs a Rust toolchain (1.89 or newer)" >&2; exit 1; }
	@test -d "$$(rustc --print sysroot)/lib/rustlib/wasm32-unknown-unknown" || \
		{ command -v rustup >/dev/null && rustup target add wasm32-unknown-unknown; } || { \
		echo "the playground needs Rust's target wasm32-unknown-unknown: install Rust by rustup, or the target as a package of your system" >&2; exit 1; }
	@touch $@

web/node_modules/.installed: web/package.json web/package-lock.json | web/.tools
	npm --prefix web ci --silent
	@touch $@

$(BINDGEN): web/bindgen/Cargo.lock web/bindgen/src/main.rs | web/.tools
	CARGO_TARGET_DIR=target/bindgen cargo build --release --locked --quiet --manifest-path web/bindgen/Cargo.toml
	@touch $@

web/generated/core.bin: $(WASM_SOURCES) $(BINDGEN) | web/.tools
	@echo "== compiling the core to WebAssembly: about two minutes the first time"
	CARGO_TARGET_DIR=target/wasm cargo build --release --locked -p bowstring-wasm --target wasm32-unknown-unknown
	$(BINDGEN) $(WASM) web/generated

$(PAGE): web/generated/core.bin web/node_modules/.installed $(WEB_SOURCES)
	npm --prefix web run --silent build
	cp web/dist/index.html $@

test-playground: playground $(VENV)/.built ## the page in a headless Chromium, and its core beside Python's
	$(BIN)/python web/tests/random_robots.py target/random-robots.json
	npm --prefix web test

paper-figures: build $(VENV)/.installed-test ## the figures of paper/paper.md and the numbers it quotes
	$(BIN)/python paper/figures.py

wheel: playground ## the wheel of this machine, in dist/
	$(PYTHON) packaging/build_wheel.py

sdist: ## the source distribution, in dist/
	$(PYTHON) packaging/build_wheel.py --sdist

check-wheel: ## install the wheel where there is no Rust, run the study and a smoke test
	$(PYTHON) packaging/check_wheel.py

check-sdist: ## build and install the source distribution in an empty folder
	$(PYTHON) packaging/check_sdist.py

check-version: ## TAG=v1.2.3 names the version of the package
	@grep -qxF 'version = "$(TAG:v%=%)"' Cargo.toml || \
		{ echo "the tag $(TAG) is not the version in Cargo.toml" >&2; exit 1; }

clean:
	rm -rf docs/_build dist .venv-wheel web/dist web/generated web/node_modules web/.tools $(PAGE)
	rm -rf $(VENV) .venv-peers .venv-lowest-direct .venv-highest target

LOCK := uv pip compile --universal --no-header --no-annotate --generate-hashes --no-emit-index-url --no-emit-find-links
lock: ## renew the lock files (needs uv)
	$(LOCK) --python-version 3.10 --extra cad $(SMALL_EXTRAS) pyproject.toml requirements/build.in requirements/dev.in -o requirements/all.lock
	$(LOCK) --python-version 3.10 pyproject.toml requirements/build.in -c requirements/all.lock -o requirements/base.lock
	$(LOCK) --python-version 3.10 $(SMALL_EXTRAS) pyproject.toml requirements/build.in requirements/dev.in -c requirements/all.lock -o requirements/test.lock
	$(LOCK) --python-version 3.11 pyproject.toml requirements/build.in requirements/docs.in -c requirements/all.lock -o requirements/docs.lock
	$(LOCK) --python-version 3.10 requirements/wheel.in -o requirements/wheel.lock
	uv pip compile --universal --python-version 3.10 --no-header --no-annotate requirements/peers.in -o requirements/peers.lock
