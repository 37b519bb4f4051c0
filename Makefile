# What a person types. Each target says what it does: `make help`.
# Everything here is plain cargo underneath; `cargo build` alone gives working binaries.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

CARGO ?= cargo
COHORT ?= examples/coa-seven
TARGET := $(if $(CARGO_TARGET_DIR),$(CARGO_TARGET_DIR),target)
BIN := $(TARGET)/release

# The two programs that are installed. What developers measure with is another workspace, dev/, which compiles the crates once more.
BUILD := $(CARGO) build --release --locked --bins
DEV := --release --locked --manifest-path dev/Cargo.toml

# The worker on MPI ranks is the one thing that needs an MPI, and is left out where there is none.
BUILD_MPI := $(CARGO) build --release --locked --package cardiotwin-worker --features mpi --bin cardiotwin-worker-mpi

.PHONY: wheel test-python test-notebooks worked-changes help book install package vendor deps deps-demo build build-all test-mpich demo test test-all test-long bench work-precision evaluate-discover learn-discrepancies learn-bands second-cohort afterload verify slurm-kills clean-run

help: ## print this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-18s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

deps: ## install what build and tests need and this machine lacks (Debian, with root or sudo); says what
	@deploy/deps.sh test

deps-demo:
	@deploy/deps.sh demo

build: ## build the coordinator (cardiotwin) and the worker (cardiotwin-worker) in release; cardiotwin-worker-mpi where an MPI is found
	$(BUILD)
	@if missing=$$(deploy/mpi-found.sh); then $(BUILD_MPI); else echo "cardiotwin-worker-mpi is not built: $$missing"; fi

build-all: build ## as `make build`, with the programs of developers (cardiotwin-dev: benchmarks, mechanics cases)
	$(CARGO) build $(DEV) --workspace --bins

demo: deps-demo build ## fit an afterload, find a hidden effect, personalise the bundled seven patients; ends with what was done, how good it is, what to open
	@deploy/demo.sh $(BIN) $(COHORT) $(TARGET)/demo

test: ## set up what is missing, then pass every check and test; prints how long each part took
	@.ci/parts.sh

test-all: ## as `make test`, with the long tests of the wheel, the reported numbers, the book, Slurm and FEniCSx (how long they took: docs/long-tests.md)
	@CARDIOTWIN_TESTS=all .ci/parts.sh

test-long: ## the long tests alone: the wheel, the reported numbers, the book, kills and ends of jobs on a real Slurm of this machine, FEniCSx in a bare Debian 13 (how long they took: docs/long-tests.md)
	@CARDIOTWIN_TESTS=long .ci/parts.sh

MPICH_TARGET := $(TARGET)/mpich
test-mpich: ## build the worker with MPICH beside Open MPI, and pass its tests and a cohort's on MPICH's ranks (Debian: mpich libmpich-dev)
	MPICC=mpicc.mpich CARDIOTWIN_MPIRUN=mpirun.mpich CARGO_TARGET_DIR=$(MPICH_TARGET) \
		$(CARGO) test --release --locked --package cardiotwin-worker --features mpi --test mpi
	$(CARGO) test --release --locked --workspace --test slurm -- --ignored MPICH

book: ## make the book of all documents into target/book/html, and check its links (mdbook, python3)
	docs/book/build.sh $(TARGET)/book

wheel: ## make dist/cardiotwin-VERSION-*.whl, a package for Python 3.10 and newer with the programs inside (docs/python.md)
	python/build-wheel.sh dist

test-python: ## make the wheel, install it into a new virtual environment, and test what was installed (packages from PyPI)
	python/test.sh

test-notebooks: ## of these tests the notebooks alone; they are kept with their pictures in target/python-test/notebooks
	python/test.sh --notebooks

PREFIX ?= /usr/local
install: build ## put programs, manual, completions, site profiles and a modulefile under PREFIX (DESTDIR before it)
	deploy/install.sh $(PREFIX) $(BIN)

package: ## make dist/cardiotwin-VERSION-ARCH.tar.gz with a static coordinator (musl; docs/installing.md)
	deploy/package.sh dist

vendor: ## make dist/cardiotwin-VERSION-source.tar.gz with the sources of all dependencies, for builds without network
	deploy/vendor.sh dist

bench: build-all ## measure the figures of docs/benchmarks.md on this machine
	$(CARGO) bench --locked --manifest-path dev/Cargo.toml --workspace
	$(BIN)/cardiotwin-dev bench beat
	$(BIN)/cardiotwin-dev bench cell
	$(BIN)/cardiotwin-dev bench orchestration
	$(BIN)/cardiotwin-dev bench orchestration --spawn
	$(BIN)/cardiotwin-dev bench orchestration --kill
	$(BIN)/cardiotwin-dev bench slurm
	folder=$$(mktemp -d) && $(BIN)/cardiotwin sweep gsa --out $$folder/gsa; status=$$?; rm -rf -- "$$folder"; exit $$status

PYTHON_ENV := $(TARGET)/work-precision-env
work-precision: ## measure and draw docs/images/work-precision.svg beside SciPy's solvers (Python 3.11 or newer)
	test -x $(PYTHON_ENV)/bin/python || python3 -m venv $(PYTHON_ENV)
	$(PYTHON_ENV)/bin/pip install --quiet --requirement solver/cell-engine/reference/requirements.txt
	PYTHONDONTWRITEBYTECODE=1 $(PYTHON_ENV)/bin/python -W ignore solver/cell-engine/reference/work_precision.py

EVALUATION := $(TARGET)/evaluate-discover
JOBS ?= 2
EXAMPLE := $(CARGO) run $(DEV) --quiet --example
# Healthy hearts of seed 900 are kept apart: nothing is evaluated on them.
learn-discrepancies: ## learn how the base model of discover misses healthy hearts of three formulations: writes solver/discover/src/learnt.json
	mkdir -p $(EVALUATION)
	$(EXAMPLE) finite-element-hearts -- $(EVALUATION)/finite-element-900.jsonl --nulls 40 --seed 900 --jobs $(JOBS)
	$(EXAMPLE) discrepancies -- solver/discover/src/learnt.json --hearts 100 --seed 900 --beats $(EVALUATION)/finite-element-900.jsonl --jobs $(JOBS)

# Seeds of patients that nobody looked at before the program that searches them was finished: each is looked at once.
EVALUATION_SEED ?= 2026112703
ONE_SEED := --seed $(EVALUATION_SEED) --jobs $(JOBS)
HEARTS := --nulls 40 --singles 64 --doubles 10 $(ONE_SEED)
IN_3D := --nulls 24 --singles 36 --seed $(EVALUATION_SEED)
CLINIC := --no-visibility --measurements aortic_pressure,aortic_flow,mitral_flow,atrial_pressure,valve_times,qrs
# Labels of a set with further measurements are those of the same hearts without them.
SETS := elastance sarcomeres finite-element elastance-clinic sarcomeres-clinic same
evaluate-discover: ## search the made patients of docs/missing-effects.md and draw its pictures (long; goes on where it stopped)
	mkdir -p $(EVALUATION)
	$(EXAMPLE) finite-element-hearts -- $(EVALUATION)/finite-element.jsonl $(IN_3D) --jobs $(JOBS)
	$(EXAMPLE) validation -- $(EVALUATION)/elastance $(HEARTS) --off 6
	$(EXAMPLE) validation -- $(EVALUATION)/sarcomeres --model sarcomeres $(HEARTS)
	$(EXAMPLE) validation -- $(EVALUATION)/finite-element --beats $(EVALUATION)/finite-element.jsonl $(IN_3D) --jobs $(JOBS)
	$(EXAMPLE) validation -- $(EVALUATION)/elastance-clinic $(CLINIC) $(HEARTS)
	$(EXAMPLE) validation -- $(EVALUATION)/sarcomeres-clinic $(CLINIC) --model sarcomeres $(HEARTS)
	$(EXAMPLE) validation -- $(EVALUATION)/same --model same --nulls 20 --singles 32 $(ONE_SEED)
	for set in $(SETS); do $(EXAMPLE) evaluate -- $(EVALUATION)/$$set --out $(EVALUATION)/$$set.jsonl --jobs $(JOBS) || exit 1; done
	$(EXAMPLE) figures -- docs/images $(foreach set,$(SETS),"$(set)=$(EVALUATION)/$(set:-clinic=)=$(EVALUATION)/$(set).jsonl")

# Of patients that nobody has looked at while choosing anything; 20261124 and 20261125 were looked at.
SECOND_COHORT_SEED ?= 20261126
SECOND_COHORT := $(TARGET)/second-cohort
second-cohort: build ## make twenty patients of another formulation, on whom nothing was chosen, and personalise them (docs/step3.md)
	$(EXAMPLE) validation -- $(SECOND_COHORT) --nulls 20 --singles 0 --seed $(SECOND_COHORT_SEED) --no-visibility --jobs $(JOBS)
	$(BIN)/cardiotwin run $(SECOND_COHORT) || [ $$? = 7 ] # 7: a twin is off

BANDS := $(TARGET)/learn-bands
# Hearts of these seeds are kept apart: bands are judged on hearts of another.
BANDS_COHORTS := 20261201=16 20271104=8
learn-bands: build ## learn how far changes of predict miss those of hearts of other formulations, reduced and in the law: writes solver/calibrate/src/formulations.json
	$(CARGO) build $(DEV) --example changed-loads
	for fidelity in reduced finite-element; do \
	  folders=; for cohort in $(BANDS_COHORTS); do \
	    seed=$${cohort%=*}; folder=$(BANDS)/$$fidelity/$$seed; folders=$$folders$${folders:+,}$$folder; \
	    test -e $$folder/truth.json || $(BIN)/examples/changed-loads make $$folder --seed $$seed --hearts $${cohort#*=} || exit 1; \
	    $(BIN)/cardiotwin run $$folder --fidelity $$fidelity || [ $$? = 7 ] || exit 1; \
	  done; \
	  $(BIN)/examples/changed-loads learn "$$folders" solver/calibrate/src/formulations.json --bands no --sizes learnt --cardiotwin $(BIN)/cardiotwin || exit 1; \
	done

RECORDS := examples/afterload
afterload: build ## fit and search the measured records of examples/afterload; draws the pictures of docs/afterload.md
	for record in human-1999/.csv porcine-in-vivo/-1.csv porcine-in-vivo/-2.csv porcine-in-vivo/-3.csv porcine-in-vivo/-4.csv \
	    porcine-ex-vivo/-1.csv porcine-ex-vivo/-2.csv porcine-ex-vivo/-3.csv porcine-ex-vivo/-4.csv; do \
	  flow=$(RECORDS)/$${record%%/*}/flow$${record#*/}; pressure=$${flow/flow/pressure}; \
	  echo "== $$flow"; $(BIN)/cardiotwin fit afterload $$flow $$pressure; $(BIN)/cardiotwin discover --afterload $$flow $$pressure; \
	done
	for part in human-1999/.csv=human porcine-in-vivo/-1.csv=in-vivo porcine-ex-vivo/-3.csv=ex-vivo; do \
	  record=$${part%=*}; flow=$(RECORDS)/$${record%%/*}/flow$${record#*/}; \
	  $(BIN)/cardiotwin --quiet discover --afterload $$flow $${flow/flow/pressure} --plot docs/images/afterload-$${part#*=}.svg > /dev/null; \
	done

# Tables are kept by the commit that they were made from; `make verify VERIFIED=COMMIT` draws the page anew from kept ones.
VERIFIED ?= $(shell git describe --always --dirty --exclude '*' 2> /dev/null || echo unknown)
VERIFY := $(TARGET)/verify/$(VERIFIED)
VERIFY_TABLES := $(patsubst %,$(VERIFY)/arostica2025-lv-%-cohort.csv,0a 1 0b) $(patsubst %,$(VERIFY)/arostica2025-lv-%-file.csv,0a 1 0b) \
	$(patsubst %,$(VERIFY)/static-%.csv,contraction inflation beam sphere order) \
	$(patsubst %,$(VERIFY)/motion-%.csv,order energy cube) $(patsubst %,$(VERIFY)/ep-%.txt,cell waves traces eikonal) \
	$(patsubst %,$(VERIFY)/twins-%.csv,finite-element reduced)
worked-changes: ## apply the diffs of CONTRIBUTING.md to a copy, build it, and try each change
	tests/worked-changes.sh $(TARGET)/worked-changes

verify: build-all ## compute docs/verification.md and its plots: benchmarks of the 3D mechanics, the twins of all seven patients
	$(CARGO) build $(DEV) --quiet --package cardiotwin-dev-solver --examples
	mkdir -p $(VERIFY)
	$(MAKE) --no-print-directory --jobs=2 VERIFIED=$(VERIFIED) $(VERIFY_TABLES)
	PYTHONDONTWRITEBYTECODE=1 python3 dev/solver/verification/page.py $(VERIFY) docs $(VERIFIED)

# As a cohort computes, and with what the file asks for.
$(VERIFY)/arostica2025-lv-%-cohort.csv:
	$(BIN)/cardiotwin-dev mechanics-case examples/benchmarks/arostica2025-lv-$*.toml --as-cohort --out $@.part 2> $(@:.csv=.log)
	mv $@.part $@
$(VERIFY)/arostica2025-lv-%-file.csv:
	$(BIN)/cardiotwin-dev mechanics-case examples/benchmarks/arostica2025-lv-$*.toml --out $@.part 2> $(@:.csv=.log)
	mv $@.part $@
$(VERIFY)/static-%.csv:
	$(BIN)/examples/verification-static $* > $@.part && mv $@.part $@
$(VERIFY)/motion-%.csv:
	$(BIN)/examples/verification-motion $* > $@.part && mv $@.part $@
$(VERIFY)/ep-%.txt:
	$(BIN)/examples/electrophysiology-figures $* > $@.part && mv $@.part $@
# The bundled cohort as its file is, from nothing; a run that was stopped goes on.
$(VERIFY)/twins-%.csv:
	test -d $(VERIFY)/coa-$* || { mkdir $(VERIFY)/coa-$* && cp -r examples/coa-seven/cohort.toml examples/coa-seven/patients $(VERIFY)/coa-$*; }
	$(BIN)/cardiotwin run $(VERIFY)/coa-$* --fidelity $* > $(VERIFY)/coa-$*.log 2>&1 || [ $$? = 7 ] # 7: a twin is off
	PYTHONDONTWRITEBYTECODE=1 python3 dev/solver/verification/twins.py $(BIN)/cardiotwin $(VERIFY)/coa-$* > $@.part && mv $@.part $@

KILLS ?= 10000
slurm-kills: build ## kill everything that can be killed during cohorts on a real Slurm of this machine, and on the modelled one
	CARDIOTWIN_KILLS=$(KILLS) $(CARGO) test --release --locked --workspace --lib random_kills -- --nocapture
	$(CARGO) test --release --locked --workspace --test slurm -- --ignored

clean-run: ## forget the results of the bundled cohort, so that `make demo` starts anew
	rm -rf -- $(COHORT)/run $(COHORT)/discover
