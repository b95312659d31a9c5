# make run    installs what a fresh machine lacks, builds, and runs the main job
# make test   the same, then passes every test, lint and scenario
# Each step below can be run by its own name; CI runs `make test`.

MISFIT    = target/release/misfit
SCENARIOS = springs noise_free paper efficiency hidden hose compensate_exact compensate compensate_hidden ten_poses control_loop control_loop_weights map drill
BLIND     = rich noise outliers form alias

.PHONY: run test setup build format lint unit examples scenarios blind blind-all pages pictures doc bench

run: build
	$(MISFIT) run scenarios/springs.toml

test: setup format lint unit doc examples scenarios blind pages
	@echo "all tests, lints, examples, scenarios, blind cases and pages passed"

# MuJoCo from Debian, or another copy through MUJOCO_DIR.
setup:
	@sh .ci/setup

build: setup
	cargo build --release --locked

format:
	cargo fmt --check

lint: setup
	cargo clippy --locked --all-targets -- --deny warnings

unit: setup
	cargo test --locked

doc: setup
	RUSTDOCFLAGS="--deny warnings" cargo doc --locked --no-deps

examples: setup
	cargo run --release --locked --example own_effect

scenarios: build
	@set -e; for name in $(SCENARIOS); do $(MISFIT) run scenarios/$$name.toml; echo; done

# the diagnosis on cases whose truth it does not know: five minutes on two cores
blind: build
	$(MISFIT) sweep scenarios/blind/rich.toml

# the same with outliers, a misstated noise, and laws of another form besides
blind-all: build
	@set -e; for name in $(BLIND); do $(MISFIT) sweep scenarios/blind/$$name.toml; echo; done

# reports of every kind, opened in headless Chromium (from Debian): three minutes; pictures in target/pages/shots
pages: build
	@sh .ci/pages

# the pictures of the README
pictures: build
	$(MISFIT) run scenarios/map.toml -o target/pictures
	$(MISFIT) drill scenarios/drill.toml -o target/pictures
	cp target/pictures/map.map.plant.png docs/pictures/map.png
	cp target/pictures/drill.drill.png docs/pictures/drill.png
	$(MISFIT) simulate scenarios/hidden.toml -o target/pictures/hidden.mcap
	$(MISFIT) report target/pictures/hidden.mcap -o target/pictures/hidden.html
	sh .ci/browser target/pictures/hidden.html --picture docs/pictures/report.png

bench: setup
	cargo bench --locked
