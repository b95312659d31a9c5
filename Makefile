# make run    installs what a fresh machine lacks, builds, and runs the main job
# make test   the same, then passes every test, lint and scenario
# Each step below can be run by its own name; CI runs `make test`.

MISFIT    = target/release/misfit
SCENARIOS = springs noise_free paper efficiency hidden hose compensate_exact compensate compensate_hidden ten_poses control_loop control_loop_weights map drill
BLIND     = rich noise outliers form alias
# of fuzzing, each target
SECONDS  ?= 60

.PHONY: run test test-long core measured mutants setup build replay format lint unit examples scenarios figures effect deny blind blind-all viewer \
  pages bags picture-replay pictures recordings readers doc bench fuzz peers growth instructions

run: build
	$(MISFIT) run scenarios/springs.toml

test: setup format lint unit doc core examples effect scenarios figures readers bags viewer pages measured
	@echo "all tests, lints, examples, scenarios, blind cases, recordings and pages passed"

# MuJoCo from Debian, or another copy through MUJOCO_DIR.
setup:
	@sh .ci/setup

build: setup
	cargo build --release --locked

# what `misfit replay` starts: ten minutes on two cores, the first time
replay: build
	cargo build --release --locked -p misfit-replay

format:
	cargo fmt --all --check

lint: setup
	cargo clippy --locked --workspace --all-targets -- --deny warnings

unit: setup
	rm -rf target/measured
	cargo test --locked --workspace

# the identification core on a machine without MuJoCo and without a C compiler
core:
	CC=/bin/false cargo test --locked -p misfit-core

# which tests on measurements of a real robot ran; fails where the measurements are there and one did not
measured:
	@sh .ci/measured

# what need not run each time: mutants of the numerics, all blind suites, fuzzing, and beside other tools
test-long: test blind-all mutants fuzz deny peers

# does a test fail for each change of a condition, a sign, a threshold? (cargo-mutants); hours
mutants: setup
	@command -v cargo-mutants >/dev/null || cargo install cargo-mutants --locked
	cargo mutants --package misfit-core --package misfit-campaign --file 'crates/misfit-core/src/fit/**' \
		--file 'crates/campaign/src/*.rs' --test-workspace true --jobs 1

doc: setup
	RUSTDOCFLAGS="--deny warnings" cargo doc --locked --workspace --no-deps

examples: setup
	cargo run --release --locked --example own_effect

scenarios: build
	@set -e; for name in $(SCENARIOS); do $(MISFIT) run scenarios/$$name.toml; echo; done

# what the README and the pages of docs show of the commands that take long, compared with what they print: six minutes on two cores
figures: bags
	MISFIT=$(CURDIR)/$(MISFIT) cargo test --locked --test all \
		docs::costly_commands_do_what_the_documents_say -- --ignored

# the effect of docs/add-an-effect.md put into a copy of the sources: it must keep the contract; some minutes
effect: setup
	sh .ci/effect

# the diagnosis on cases whose truth it does not know: five minutes on two cores
blind: build
	$(MISFIT) sweep scenarios/blind/rich.toml

# the same with outliers, a misstated noise, and laws of another form besides
blind-all: build
	@set -e; for name in $(BLIND); do $(MISFIT) sweep scenarios/blind/$$name.toml; echo; done

# recordings opened in the real viewer, without a screen, and the pictures looked at
viewer: setup
	cargo build --locked -p misfit -p misfit-replay
	sh .ci/viewer

picture-replay: viewer
	target/viewer/venv/bin/python -c "from PIL import Image; \
		Image.open('target/viewer/ladder.png').convert('RGB').resize((1400, 860)).quantize(256).save('docs/pictures/replay.png')"

# reports of every kind, opened in headless Chromium (from Debian): three minutes; pictures in target/pages/shots
pages: build
	@sh .ci/pages

# bags by two writers that are not ours become the same campaign
bags: build
	sh .ci/venv
	target/venv/bin/python .ci/bag.py $(MISFIT) target/bags

# the pictures of the README, but for that of the replay
pictures: build
	$(MISFIT) run scenarios/map.toml -o target/pictures
	$(MISFIT) drill scenarios/drill.toml -o target/pictures
	cp target/pictures/map.map.plant.png docs/pictures/map.png
	cp target/pictures/drill.drill.png docs/pictures/drill.png
	$(MISFIT) simulate scenarios/hidden.toml -o target/pictures/hidden.mcap
	$(MISFIT) report target/pictures/hidden.mcap -o target/pictures/hidden.html
	sh .ci/browser target/pictures/hidden.html --picture docs/pictures/report.png

# the small recordings that are kept, by the commands of their README
recordings: build
	@grep '^| `' recordings/README.md | sed 's/.*`misfit \([^`]*\)`.*/\1/' | while read -r words; do \
		$(MISFIT) --quiet $$words || exit 1; done
	@cd recordings && find . -type f ! -name '*.mcap' ! -name README.md ! -name tasks.csv -delete

# every recording decoded by two readers that are not ours
readers: build
	sh .ci/venv
	target/venv/bin/python .ci/readers.py recordings/*.mcap

# licences and sources of all packages, offline. Known vulnerabilities need the network, for the database of advisories:
# cargo deny --workspace check advisories
deny:
	@command -v cargo-deny >/dev/null || cargo install cargo-deny --locked
	cargo deny --offline --workspace check licenses bans sources

bench: setup
	cargo bench --locked

# hostile inputs, a target a parser (cargo-fuzz and a nightly toolchain): SECONDS=3600 make fuzz for an hour each
fuzz: setup
	sh .ci/fuzz $(SECONDS)

# beside FIGAROH, pybotics and SciPy on the same readings: writes docs/peers.md, fails where a claim of it does not hold
peers: build
	cargo build --release --locked --example peers
	for name in figaroh pybotics scipy; do sh .ci/venv target/peers/$$name peers/$$name.txt || exit 1; done
	python3 peers/run.py -o docs/peers.md

# how time grows with readings, parameters, joints and families: writes docs/speed.md
growth: setup
	cargo run --release --locked --example growth > target/speed.md
	mv target/speed.md docs/speed.md

# a count that other programs do not disturb: instructions of one start with one fit, equal to 1e-3 from run to run
instructions: build
	cargo build --release --locked --example peers
	$(MISFIT) simulate peers/springs.toml --csv target/peers/springs >/dev/null
	RAYON_NUM_THREADS=1 valgrind --tool=cachegrind --cache-sim=no --cachegrind-out-file=/dev/null \
		target/release/examples/peers target/peers/springs/campaign.toml joint_compliance 1 >/dev/null
