# Two commands set everything up on a fresh Debian or Ubuntu with python3 and make:
#   make demo    the main job on a picture of the project's own
#   make test    tests, linters and the type checker; make test-quick: without builds and what takes seconds; make all-tests: studies too
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DONE := $(VENV)/.installed

# torch from an index of one's own: that of PyTorch's CPU builds is a tenth of the download
TORCH_INDEX ?=
TORCH := -q -c constraints.txt --no-deps $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX)) torch==2.13.0

.PHONY: accuracy-table supports-table mounts-table accuracies-table budgets-table several-table lamps-table knots-table demo lines test tests all-tests test-quick wheel-test docs gallery lint feature-table effects-table traced-colours paper-table paper-ablations validator-table verdict-table mutations frontier worst-cases system slicer browser viewer pictures typed-pages clean

$(DONE): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --upgrade pip
	$(BIN)/python -m pip install $(TORCH)
	$(BIN)/python -m pip install -q -c constraints.txt -e '.[all]'
	$(BIN)/python -m compileall -q knotfab formats validators fixtures # pip compiles no editable package
	$(BIN)/knotfab doctor --compile
	touch $(DONE)

# VTK renders off-screen through libEGL and libGL: install them where we may, name them where not
system:
	@if ! ldconfig -p | grep -q libEGL.so.1 || ! ldconfig -p | grep -q libGL.so.1; then \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -q >/dev/null && \
	    apt-get install -y -q --no-install-recommends libegl1 libgl1 >/dev/null; \
	  else \
	    echo "Rendering needs two system libraries: sudo apt-get install libegl1 libgl1" >&2; exit 3; \
	  fi; \
	fi

# the slicer is asked where it is installed; without it its tests are skipped
slicer:
	@command -v prusa-slicer >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
	  && apt-get update -q >/dev/null \
	  && apt-get install -y -q --no-install-recommends prusa-slicer >/dev/null; } \
	  || echo "PrusaSlicer is not installed (apt-get install --no-install-recommends prusa-slicer): its tests are skipped" >&2

# the pages' tests drive Chromium, and axe-core where npm is there; without them they are skipped
browser:
	@command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null \
	  && apt-get update -q >/dev/null && apt-get install -y -q --no-install-recommends chromium >/dev/null; } \
	  || echo "Chromium is not installed (apt-get install --no-install-recommends chromium): its tests are skipped" >&2
	@[ -d web/node_modules ] || ! command -v npm >/dev/null || (cd web && npm ci --no-audit --no-fund >/dev/null) \
	  || echo "axe-core could not be installed (cd web && npm ci): its tests are skipped" >&2

demo: system $(DONE)
	$(BIN)/knotfab build examples/knight.png --print --out demo-out
	@echo "Open demo-out/report.html"

lint: $(DONE)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# lines of Python a folder, beside the budget in CONTRIBUTING.md
lines: $(DONE)
	@$(BIN)/python -m benchmarks.lines

# two workers, each on one thread: two cores are what is counted on; tests/conftest.py says who gets what
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadgroup --no-loadscope-reorder

# linters and tests side by side: a type checker keeps one core alone
test: system slicer browser $(DONE)
	@$(MAKE) --no-print-directory -j 2 lint tests

tests: $(DONE)
	$(PYTEST) -m "not study"

# whole walks too, for whose every case a cheaper one stands in `make test`
all-tests: system slicer browser $(DONE)
	$(PYTEST)

# in the middle of a change: without whole builds and what else takes seconds
test-quick: $(DONE)
	$(PYTEST) -m "not build and not slow and not study"

# the pages of docs/ as a site that can be searched, in out/site, with the schema of scene.toml; a broken link or a page outside the menu ends it
docs: $(DONE)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build -q
	@$(BIN)/knotfab schema >out/site/scene.schema.json
	@echo "$(BIN)/python -m http.server -d out/site shows it at http://localhost:8000"

# ten pieces worth hanging, and their page (about 20 min; an interrupted run goes on where it was)
gallery: system slicer $(DONE)
	$(BIN)/python -m examples.gallery out/gallery docs

# a wheel built here, in a fresh environment outside the checkout, builds a glyph with a mount (a few minutes)
wheel-test: system
	@set -e; place=$$(mktemp -d); trap 'rm -rf "$$place"' EXIT; unset PYTHONPATH; \
	$(PYTHON) -m venv "$$place/venv"; pip="$$place/venv/bin/python -m pip"; $$pip install -q --upgrade pip; \
	$$pip wheel -q --no-deps -w "$$place" .; \
	$$pip install -q -c constraints.txt "$$place"/knotfab-*.whl; $$pip check; \
	du -sm "$$place"/venv/lib/python3*/site-packages | sed 's/\t.*/ MB installed, the largest:/'; \
	du -sm "$$place"/venv/lib/python3*/site-packages/* | sort -rn | head -12; \
	cd "$$place"; venv/bin/knotfab build text:A --print --mount wall --accuracy draft --out built; \
	venv/bin/knotfab validate built; ls built

# pictures by settings, built and printed: the project's own with default settings (about 10 min), without supports beside another
# checkout (about an hour; BEFORE=../before), on every holder, at every accuracy, in every time budget, sets of several pictures (15 min), colours by
# three lamps (10 min), twelve knots tied into one picture (5 min); what was built already is not built again
accuracy-table supports-table mounts-table accuracies-table budgets-table several-table lamps-table knots-table: system slicer $(DONE)
	$(BIN)/python -m benchmarks.build_table $(@:%-table=%) --out out/$(@:%-table=%) $(if $(BEFORE),--before $(BEFORE))

# every feature in every setting, built: one view, several, a free view, a sequence (about half an hour; an interrupted
# run goes on where it was)
feature-table: system slicer $(DONE)
	$(BIN)/python -m benchmarks.features --out out/feature-table --write docs/features.md

# magnitudes of effects against brute force, soft shadows against Mitsuba 3 where it finds an LLVM (apt-get
# install libllvm19, DRJIT_LIBLLVM_PATH)
effects-table: system $(DONE)
	$(BIN)/python -m benchmarks.effects_table

# a build under several lamps, DIR, against paths that Mitsuba 3 traces through the same scene (about 1 min)
traced-colours: $(DONE)
	$(BIN)/python -m benchmarks.traced_colours $(DIR)

# everything that compares with the paper, under paper-table/; what is done is not run again (about an hour)
paper-table: system $(DONE)
	$(BIN)/python -m paper.table

# the paper's ablations, scaled down, into tables and figures under paper-ablations/
paper-ablations: $(DONE)
	$(BIN)/python -m paper.ablations

# forged and honest pieces, hostile files (about 10 min); tests/validators has thickness, broken and good parts
validator-table: system $(DONE)
	@failed=0; for table in forgery_table fuzz_files; do \
	  $(BIN)/python -m benchmarks.$$table || failed=1; done; exit $$failed

# thirty pictures as people bring them, built with default options: a person's word against the verdict's;
# resumed (about 45 min)
verdict-table: system $(DONE)
	$(BIN)/python -m benchmarks.verdict_table --out verdict-table

# whether tests notice when a comparison or a number of the validators is changed, in place: begin with a clean tree;
# as in make mutations MODULE=tube/thickness.py TESTS=tests/validators/tube
MODULE ?= check.py
TESTS ?= tests/validators/test_conclusion.py
mutations: system $(DONE)
	$(BIN)/python -m pip install -q cosmic-ray
	mkdir -p out && rm -f out/mutations.sqlite
	sed 's#MODULE#$(MODULE)#; s#TESTS#$(TESTS)#' benchmarks/mutations.toml >out/mutations.toml
	$(BIN)/cosmic-ray init out/mutations.toml out/mutations.sqlite
	$(BIN)/cr-filter-operators out/mutations.sqlite out/mutations.toml
	$(BIN)/cosmic-ray exec out/mutations.toml out/mutations.sqlite
	$(BIN)/cr-report out/mutations.sqlite

# what accuracy costs in time: whole builds of the knight with --print, of it and the cat without; an interrupted run goes on
frontier: $(DONE)
	$(BIN)/python -m benchmarks.frontier --write docs --time-limit 25m

# renderers, losses, terms, network, certificates and bounds of effects searched for worse cases (an hour)
worst-cases: $(DONE)
	KNOTFAB_EXAMPLES=2000 $(BIN)/python -m pytest --timeout 3600 tests/benchmarks/hard/test_values.py -k no_search

# the viewer of report and studio, bundled from web/ with three.js: knotfab/report/viewer (needs node)
viewer:
	cd web && npm ci --no-audit --no-fund && npm run build

# the pictures of README's first screen and of the studio's page: builds, a film and a browser (some minutes)
pictures: demo browser
	$(BIN)/python -m examples.off_and_on demo-out docs/piece.webp
	$(BIN)/python -m benchmarks.readme_figures demo-out
	$(BIN)/python -m examples.search_film examples/knight.png docs/search.gif
	$(BIN)/python -m examples.studio_pictures examples/knight.png docs

# README's and the tutorial's commands, typed as they stand there, with their promises (about 15 min)
typed-pages: system slicer $(DONE)
	$(BIN)/python -m benchmarks.typed_pages

clean:
	rm -rf $(VENV) demo-out out
