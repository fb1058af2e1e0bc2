# nvsprior: `make demo` runs the main job on the embedded scene, `make test` passes the tests.

# Where the shader builder is kept between builds, outside of the tree: it takes minutes to build.
SHADER_TARGET ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/nvsprior/shaders
# The oldest glibc of the boards that the library is shipped for: JetPack 5.
GLIBC ?= 2.31
SHADER_TOOLCHAIN := nightly-2026-08-15

# What every command that builds the tests' profile names: cargo builds crates anew for another choice of packages.
ALL := --workspace --exclude nvsprior-gst --exclude nvsprior-python

.PHONY: help demo console console-test console-walk console-soak link-soak \
	demo-prior tower-prior ageing calibration quick test \
	long-test other-devices gst gst-test c-test c-test-memory \
	lint lib install uninstall package portability package-test firmware cross-aarch64 poses-test first-dive \
	licences deb deb-test dist dist-test subproject-test abi-check abi-baseline semver-check shaders shaders-check \
	shader-toolchain gpu-check device-report clean paper-test setup-test conformance vectors figures docs-tables \
	wheel wheel-aarch64 python-test frame-times fuzz

help:
	@echo "make demo           encode and decode the embedded scene; tables and pictures in demo-out/"
	@echo "make console        vehicle, channel and the pilot's page, on the demo's frames: docs/console.md"
	@echo "make console-test   that page in headless Chromium; RENEW=1 renews the pictures in docs/console/"
	@echo "make console-walk   the page while programs are killed, keys and priors are wrong: 30 minutes; SEED, MINUTES"
	@echo "make console-soak   eight hours of packets through the console, in fast motion: is its memory flat?"
	@echo "make link-soak      both ends of a link by losses, restarts, jumping clocks: 10,000 dives, 100 with a device"
	@echo "make demo-prior     train the demo's prior again, from the scene's mapping run: a quarter of an hour"
	@echo "make tower-prior    a prior of the tower in black water, from M4: COURSE=approach|arcs|both, LENS=33|80"
	@echo "make first-dive     from a survey's video to a decoded dive, each step timed: docs/first-dive.md"
	@echo "make poses-test     poses of the mapping run's pictures by pycolmap, against the true ones; some minutes"
	@echo "make calibration    how far poses are off, beside what the program says of them: an hour"
	@echo "make ageing         bytes of a frame as the demo's site ages, by streams and mapping: half an hour"
	@echo "make quick          unit tests, and tests that need few frames: at most three minutes"
	@echo "make test           the tests: 20 minutes, compiling counted"
	@echo "make long-test      those that take long: the laboratory's commands, memory"
	@echo "make fuzz           each target of fuzz/ a million times: fuzz/README.md; RUNS, TARGETS=\"ply survey\""
	@echo "make conformance    the decoder in Python against the vectors of docs/format.md; installs numpy"
	@echo "make vectors        makes these vectors anew"
	@echo "make figures        measures what the documents show, into docs/results/: two hours, goes on after a cut;"
	@echo "                    QUICK=1: minutes, compares only; ONLY=\"demo reef\": these; AGAIN=1: what is there, too"
	@echo "make docs-tables    writes the tables of the documents from docs/results/"
	@echo "make wheel          the Python package, in target/wheels/: docs/python.md; make wheel-aarch64 for 64-bit ARM"
	@echo "make python-test    its tests, in a Python of their own"
	@echo "make gst            the GStreamer plugin, in target/release/: docs/gstreamer.md"
	@echo "make gst-test       its tests, and that document's pipelines on the demo's frames"
	@echo "make c-test         the installed C library: header, examples, sanitizers, a soak"
	@echo "make c-test-memory  the same programs under valgrind, and without memory: each allocation fails once; an hour"
	@echo "make lint           formatting, clippy, arrows between files, lengths of lines"
	@echo "make lib            the C library, in target/"
	@echo "make install        the C library with header, pkg-config and CMake files, to PREFIX"
	@echo "                    (/usr/local), LIBDIR and INCLUDEDIR there, all below DESTDIR"
	@echo "make uninstall      removes it; give the same variables"
	@echo "make firmware       the C library at its smallest, for glibc 2.31 and newer, in target/; prints sizes"
	@echo "make other-devices  the same pictures on SwiftShader, and the library's definition on 64-bit ARM, under QEMU"
	@echo "make portability    the same pictures on Mesa, old and new, and SwiftShader; fetches the drivers"
	@echo "make package        the crates as they are published, each built from its packed file"
	@echo "make package-test   programs against the installed library, shared and static"
	@echo "make deb            Debian packages for amd64 and arm64, in target/debian/: docs/packaging.md"
	@echo "make deb-test       installs, uses and removes them in a Debian of their own"
	@echo "make dist           the source archive with all crates, and recipes for Conan and vcpkg, in target/dist/"
	@echo "make dist-test      builds the library from it without a network"
	@echo "make subproject-test  a program with nvsprior as a subproject of CMake and of Meson"
	@echo "make abi-check      compares the C library's ABI with the committed one; make abi-baseline renews that"
	@echo "make semver-check   compares the Rust library's API with that of the last release"
	@echo "make licences       the lists of what is linked in, after a change of dependencies; needs cargo-about and"
	@echo "                    cargo-cyclonedx"
	@echo "make cross-aarch64  as package-test, for 64-bit ARM, under QEMU: docs/packaging.md"
	@echo "make paper-test     the paper's learned baselines (tools/paper) in a Python of their own; installs PyTorch"
	@echo "make setup-test     runs targets in a bare Debian, as a new user would: TARGETS=\"demo test lib deb\""
	@echo "make shaders        rebuild the SPIR-V modules in shaders-rs/kernels from their Rust sources"
	@echo "make shaders-check  rebuild them elsewhere and compare"
	@echo "make device-report  measure this machine's Vulkan device, at most 8 minutes once built: docs/latency.md;"
	@echo "                    report and page in target/device-report/; DEVICE=NAME chooses another device"
	@echo "make frame-times    most and 99 % of frame times, lost, in darkness and silt, without a bound and with one;"
	@echo "                    MS=N: the bound; PRIOR and CAMERAS: of other frames than the demo's"
	@echo "make gpu-check      ask a GPU's compiler about them, without a GPU: docs/latency.md; RENEW=1 renews its table"

# A program of its own, by the profile that compiles fast. `nvsprior demo` does the same.
demo:
	@scripts/setup.sh run
	cargo run -p nvsprior-demo -- --out demo-out

console:
	@scripts/setup.sh run
	cargo build --release --bin nvsprior
	scripts/console.sh demo-out

console-test:
	@scripts/setup.sh run browser
	cargo test --release -p nvsprior-cli --features browser --test browser -- --nocapture

console-walk:
	@scripts/setup.sh run browser
	cargo test --release -p nvsprior-cli --features browser --test browser -- --ignored --nocapture walk

console-soak:
	@scripts/setup.sh run
	cargo test --release -p nvsprior-console --lib memory_is_flat -- --ignored --nocapture

# Other dives: SEED=10001.
link-soak:
	@scripts/setup.sh run
	DIVES=10000 DEVICE_DIVES=100 cargo test -p nvsprior-link --lib -- tests --nocapture

# The loss is the one that the prior in the tree was trained with.
demo-prior:
	@scripts/setup.sh run
	cargo run --release --bin nvsprior-lab -- draw --mapping-run --out target/demo-prior
	cargo run --release --bin nvsprior -- map --cameras target/demo-prior/M1/cameras.json --splats 60000 --knee 0 \
		--out tools/basin/prior.nvsg --report target/demo-prior/report

# Which course of M4 the tower's prior is made from, by which lens, and where to.
COURSE ?= both
LENS ?= 33
TOWER := target/tower-$(COURSE)-$(LENS)

tower-prior:
	@scripts/setup.sh run
	cargo run --release --bin nvsprior-lab -- draw --site tower --mapping-run --course $(COURSE) --lens $(LENS) \
		--out $(TOWER)
	cargo run --release --bin nvsprior -- map --cameras $(TOWER)/M4/cameras.json --out $(TOWER)/prior.nvsg \
		--report $(TOWER)/report

# What a survey team does with its own video, on one that the program draws.
first-dive:
	@scripts/setup.sh run video poses
	cargo build --release --bins
	scripts/first-dive.sh target/first-dive

poses-test:
	@scripts/setup.sh run poses
	cargo test -p nvsprior-cli --test cli -- --ignored --nocapture pycolmap_finds

# How bytes grow with the age of the site: docs/mapping.md. Half an hour.
ageing:
	@scripts/setup.sh run
	cargo build --release -p nvsprior-cli -p nvsprior-lab --bins --example ageing
	target/release/examples/ageing target/release tools/basin/prior.nvsg target/ageing

# What poses are worth: docs/poses.md. An hour.
calibration:
	@scripts/setup.sh run
	cargo build --release --bins
	python3 scripts/calibration.py target/calibration

# The unit tests, and the integration tests that need no device or few frames.
quick:
	@scripts/setup.sh run test
	cargo test $(ALL) --lib --test architecture \
		--test conformance --test definition --test encode_decode --test fuzz_corpus --test payload_start --test modules \
		--test prior_formats --test search --test stream --test wavelet

# The examples are `make lint`'s: each takes as long to link as a program.
test:
	@scripts/setup.sh run test
	cargo test $(ALL) --lib --bins --tests
	cargo test $(ALL) --doc

# They have `test = false` in Cargo.toml.
long-test:
	@scripts/setup.sh run test
	cargo test $(ALL) --test capi --test long --test mapper --test trainer

conformance:
	@scripts/setup.sh conformance
	scripts/conformance.sh

vectors:
	@scripts/setup.sh run test
	RENEW=1 cargo test $(ALL) --test conformance

figures:
	@scripts/setup.sh run
	cargo build --release -p nvsprior-cli -p nvsprior-lab -p nvsprior-demo --bins
	scripts/figures/measure.py $(if $(QUICK),--quick) $(if $(AGAIN),--again) $(ONLY)

docs-tables:
	scripts/figures/tables.py

wheel:
	@scripts/setup.sh python glibc
	GLIBC=$(GLIBC) scripts/wheel.sh

wheel-aarch64:
	@scripts/setup.sh python cross glibc
	GLIBC=$(GLIBC) scripts/wheel.sh aarch64-unknown-linux-gnu

python-test:
	@scripts/setup.sh run python
	scripts/python-test.sh

gst:
	@scripts/setup.sh run gst
	cargo build --release --package nvsprior-gst

gst-test:
	@scripts/setup.sh run test gst
	scripts/gst-test.sh

c-test:
	@scripts/setup.sh run lib c
	scripts/c-test.sh full

c-test-memory:
	@scripts/setup.sh run lib c
	scripts/c-test.sh library c_programs memcheck every_allocation limits

lint:
	@scripts/setup.sh lint
	python3 scripts/arrows.py selftest
	python3 scripts/arrows.py
	python3 scripts/lines.py
	python3 scripts/counts.py
	python3 scripts/figures/tables.py check
	python3 scripts/licences.py check
	cargo fmt --all --check
	cargo clippy $(ALL) --all-targets -- -D warnings
	cargo clippy -p nvsprior --no-default-features --example topside -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --lib --package nvsprior --package nvsprior-kernels \
		--package nvsprior-link --package nvsprior-formats --package nvsprior-capi

lib:
	@scripts/setup.sh lib
	cargo cbuild --release -p nvsprior-capi

install:
	@scripts/setup.sh lib
	scripts/install.sh

uninstall:
	scripts/uninstall.sh

package:
	@scripts/setup.sh
	scripts/package.sh

portability:
	@scripts/setup.sh run
	scripts/portability.sh

other-devices:
	@scripts/setup.sh run cross
	scripts/portability.sh swiftshader
	scripts/cross-test.sh aarch64-unknown-linux-gnu definition

package-test:
	@scripts/setup.sh lib c
	scripts/package-test.sh

firmware:
	@scripts/setup.sh lib c glibc
	GLIBC=$(GLIBC) KEEP=target/nvsprior-firmware-$(shell uname -m) scripts/package-test.sh firmware
	cargo build --profile firmware -p nvsprior --no-default-features --example topside
	@echo "  a topside that only decodes: $$(wc -c < target/firmware/examples/topside) bytes"

cross-aarch64:
	@scripts/setup.sh lib c cross glibc
	GLIBC=$(GLIBC) KEEP=target/nvsprior-firmware-aarch64 \
		scripts/package-test.sh firmware aarch64-unknown-linux-gnu
	scripts/cross-test.sh aarch64-unknown-linux-gnu definition
	scripts/cross-test.sh aarch64-unknown-linux-gnu wavelet on_every_processor
	scripts/cross-test.sh aarch64-unknown-linux-gnu small_blocks on_every_processor
	scripts/cross-test.sh aarch64-unknown-linux-gnu displaced on_every_processor
	scripts/c-hosts-aarch64.sh target/nvsprior-firmware-aarch64 \
		float_environment small_stack structs nulls keys images encoding decoding

fuzz:
	scripts/fuzz.sh $(or $(RUNS),1000000) $(TARGETS)

dist:
	@scripts/setup.sh dist
	scripts/dist.sh

dist-test: dist
	@scripts/setup.sh lib c dist
	scripts/dist-test.sh

subproject-test:
	@scripts/setup.sh lib c meson
	scripts/subproject-test.sh

abi-check:
	@scripts/setup.sh c
	scripts/abi.sh selftest
	scripts/abi.sh check

abi-baseline:
	@scripts/setup.sh c
	scripts/abi.sh baseline

semver-check:
	scripts/semver.sh

setup-test:
	scripts/setup-test.sh $(TARGETS)

paper-test:
	@scripts/setup.sh run paper python
	scripts/paper-test.sh

licences:
	@scripts/setup.sh licences
	scripts/licences.py write

deb:
	@scripts/setup.sh lib $(if $(findstring arm64,$(or $(DEB_ARCHITECTURES),arm64)),cross) glibc deb
	scripts/deb.sh $(DEB_ARCHITECTURES)

deb-test:
	@scripts/setup.sh lib c run deb
	scripts/deb-test.sh

shader-toolchain:
	@scripts/setup.sh shaders
	rustup toolchain install $(SHADER_TOOLCHAIN) --profile minimal \
		--component rust-src,rustc-dev,llvm-tools

shaders: shader-toolchain
	cd shaders-rs && CARGO_TARGET_DIR=$(SHADER_TARGET) cargo run --release -p nvsprior-shaders-build

shaders-check: shader-toolchain
	cd shaders-rs && CARGO_TARGET_DIR=$(SHADER_TARGET) cargo run --release -p nvsprior-shaders-build -- --check

gpu-check:
	@scripts/setup.sh gpu-check
	cargo build $(ALL) --bin nvsprior-lab
	$${CARGO_TARGET_DIR:-target}/debug/nvsprior-lab gpu-check $(if $(RENEW),--renew)

frame-times: $(if $(PRIOR),,demo)
	cargo run --release --bin nvsprior-lab -- frame-times $(if $(MS),--bound $(MS)) \
		--prior $(or $(PRIOR),demo-out/prior.ply) --cameras $(or $(CAMERAS),demo-out/T1/cameras.json) \
		--report target/frame-times

device-report:
	@scripts/setup.sh run
	cargo run --release --bin nvsprior-lab -- device-report --out target/device-report $(if $(DEVICE),--device "$(DEVICE)")

clean:
	rm -rf target demo-out bench-out
