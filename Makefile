# make setup       a virtual environment in .venv with everything the targets below need
# make test        all tests
# make smoke       two small pictures in seconds, checked
# make figures     the paper's figures 10, 12, 13, 14 by the beam estimate; PHOTONS=3.24e8 is the paper's size
# make table1      the paper's table 1: seconds of each stage, point against beam
# make test-all    the slow tests too
# make check       the photon walk against the tables of layered slabs, quantity by quantity
# make bench       speed of the photon walk beside the floor of this machine
PYTHON ?= python3
PHOTONS ?= 5e7
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
FIGURES := fig10_forearm fig12_epidermal fig13_papillary fig14_deep
METHODS := point beam

.PHONY: setup test test-all check smoke figures table1 bench clean $(FIGURES)

setup: $(INSTALLED)

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[dev]'
	touch $@

test: $(INSTALLED)
	$(BIN)/pytest -q

test-all: $(INSTALLED)
	$(BIN)/pytest -q -m ""

check: $(INSTALLED)
	for table in layered_slabs slab_fields slab_radial; do \
	  $(BIN)/skinrender check --slabs tests/truth/$$table.json -o out/check/$$table || exit; \
	done

smoke: $(INSTALLED)
	for method in $(METHODS); do \
	  mkdir -p out/smoke/smoke_$$method; \
	  $(BIN)/skinrender render configs/smoke_$$method.yaml -o out/smoke/smoke_$$method --json \
	    > out/smoke/smoke_$$method/summary.json || exit; \
	done
	$(BIN)/python tests/smoke_check.py out/smoke

figures: $(FIGURES)

$(FIGURES): $(INSTALLED)
	$(BIN)/skinrender render configs/$@.yaml --method beam --photons $(PHOTONS) -o out/figures/$@

table1: $(INSTALLED)
	for method in $(METHODS); do \
	  $(BIN)/skinrender render configs/fig10_forearm.yaml --method $$method --photons $(PHOTONS) \
	    --gather-count 32400 --set photons.roulette=false -o out/table1/$$method || exit; \
	done
	$(BIN)/python -m skinrender.analysis.table1 out/table1/point out/table1/beam

bench: $(INSTALLED)
	$(BIN)/python -m benchmarks.walk

clean:
	rm -rf out $(VENV)
