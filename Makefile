# Everything a newcomer needs, from Python >= 3.10 with pip, a stable Rust toolchain and make.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
EXTRAS := plot,metrics,io,cli,sweep,cluster,bake,scenes,mitsuba,denoise,widget
# Tests in processes of their own, one a core; neighbours share what a file prepares.
PARALLEL := --numprocesses auto --dist worksteal
SOURCES := $(shell find src -name '*.rs') Cargo.toml pyproject.toml

.PHONY: demo docs test test-rust test-python test-slow notebooks lint lint-rust lint-python bench fuzz wheels aarch64 clean
.DEFAULT_GOAL := test

$(VENV)/.tools: pyproject.toml requirements-dev.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade "pip>=23.1"
	$(BIN)/python -m pip install --quiet -r requirements-dev.txt
	$(BIN)/python -m pip install --quiet --no-deps -r requirements-models.txt
	touch $@

$(STAMP): $(VENV)/.tools $(SOURCES)
	$(BIN)/python -m pip install --quiet "maturin>=1.9.4,<2"
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --quiet --extras $(EXTRAS)
	touch $@

## Renders the Stanford bunny's soft shadows into demo/, with a page about the methods, demo/report.html. Slow methods
## are left out after BUDGET seconds, and listed with what they would take; BUDGET=0 renders with all.
BUDGET ?= 40
demo: $(STAMP)
	$(BIN)/python examples/demo.py demo --budget $(BUDGET)

$(VENV)/.docs: $(STAMP) requirements-docs.txt
	$(BIN)/python -m pip install --quiet -r requirements-docs.txt
	touch $@

## Builds the documentation site, site/html/index.html, offline; warnings and links that lead nowhere are errors.
docs: $(VENV)/.docs
	rm -rf site docs/api
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --jobs 2 -c docs -d site/doctrees . site/html
	$(BIN)/python docs/check_site.py site/html

## Runs every test, Rust and Python, but long studies.
test: test-rust test-python

test-rust:
	cargo test --no-default-features --quiet

test-python: $(STAMP)
	$(BIN)/python -m pytest $(PARALLEL)

## Runs long studies of what short tests claim, too.
test-slow: $(STAMP)
	$(BIN)/python -m pytest $(PARALLEL) -m slow

## Runs the notebooks, or those of NOTEBOOKS, and stores them with their outputs.
notebooks: $(STAMP)
	$(BIN)/python tests/run_notebooks.py $(NOTEBOOKS)

## Runs the Rust tests for AArch64, whose bits must be those of x86-64: with a cross compiler and QEMU's user mode
## (Debian: gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user; and rustup target add $(AARCH64)).
AARCH64 := aarch64-unknown-linux-gnu
aarch64:
	CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
	CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L /usr/aarch64-linux-gnu" \
	cargo test --no-default-features --target $(AARCH64) --quiet

## Formatters, linters and type checkers; warnings are errors.
lint: lint-rust lint-python

# Needs nothing installed, so that `make -j2` does it while the package is built.
lint-rust:
	cargo fmt --check
	cargo clippy --all-targets --quiet -- -D warnings
	cargo clippy --all-targets --no-default-features --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --no-default-features --document-private-items --quiet

lint-python: $(STAMP)
	$(BIN)/ruff format --check python tests benches examples notebooks docs/*.py
	$(BIN)/ruff check python tests benches examples notebooks docs/*.py
	$(BIN)/mypy
	$(BIN)/stubtest softshadow._core

## Speed against Mitsuba, and the methods' speed against error; see benches/README.md.
bench: $(STAMP)
	$(BIN)/python benches/mitsuba_speed.py
	$(BIN)/python benches/wedges.py
	$(BIN)/python benches/ssoc.py
	$(BIN)/python benches/accumulation.py
	$(BIN)/python benches/single_sample.py
	$(BIN)/python benches/map_rivals.py
	$(BIN)/python benches/layered.py
	$(BIN)/python benches/widget.py

## Random scenes through all methods for an hour, from case SEED on; see tests/fuzz.
SECONDS ?= 3600
SEED    ?= 0
fuzz: $(STAMP)
	cd tests && ../$(BIN)/python -m fuzz --seconds $(SECONDS) --seed $(SEED)

## Wheels for every Linux since glibc 2.17, on x86-64 and on Arm, and the source, into dist/.
TARGETS ?= x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu
wheels: $(VENV)/.tools
	$(BIN)/python -m pip install --quiet "maturin>=1.9.4,<2" "ziglang>=0.13"
	rm -rf dist
	! command -v rustup > /dev/null || rustup --quiet target add $(TARGETS)
	export PATH="$(abspath $(BIN)):$$PATH" && for target in $(TARGETS); do \
		maturin build --quiet --release --zig --target $$target --compatibility manylinux2014 \
			--out dist || exit 1; \
	done
	$(BIN)/maturin sdist --out dist
	ls -l dist

clean:
	rm -rf $(VENV) target demo dist site docs/api
