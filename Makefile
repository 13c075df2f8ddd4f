# make setup       a virtual environment in .venv with everything the targets below need
# make test        all tests
# make smoke       two small pictures in seconds, checked
# make figures     the paper's figures 10, 12, 13, 14 by the beam estimate; PHOTONS=3.24e8 is the paper's size
# make table1      the paper's table 1: seconds of each stage, point against beam
# make methods     figures 12 and 14 by beam, point and reference beside each other, with differences: out/methods
# make paper-scale the paper's whole figure 10 by beam and by point (PAPER_PHOTONS=3.24e8): seconds, memory, limits; 12 GB of disk
# make error-time  error against run time on two scenes of 64 x 64 pixels, at most about half an hour: a page in out/error_time
# make measured-skin  the presets beside measured skin: table and plot in out/measured_skin
# make lesion-table   color of lesions by depth and amount, and how deep light goes: out/lesion_table
# make gallery     sites, tones, ages, lesions and lights on one sheet: out/gallery/gallery.png
# make noise       figure 10 at the paper's settings and at ours in the same time: out/noise/noise.png; PAPER_PHOTONS=3.24e8
# make fit-tones   the fit behind skin.tone
# make faults      kills at random moments of real runs: tries, kills survived, bytes lost; TRIES=200 each with 1 and 2 workers
# make fuzz        scenes, npz files and images made up at random, FUZZ_SECONDS=60 each
# make soak        renders in a loop for SOAK_SECONDS=3600: memory flat, nothing left behind
# make test-all    the slow tests too
# make stability   the stiff and extreme cases: what could break, what was measured, its bound
# make search      draws valid scenes at random until one breaks (SEARCH_EXAMPLES=300)
# make check       the photon walk against the tables of layered slabs, quantity by quantity
# make cross-check pictures against Mitsuba, absorption against MCX (installs the extra interop; MCX wants an OpenCL device)
# make docs        the documentation as a site, in site/
# make bench       speed of the photon walk beside the floor of this machine, of the estimates, and `plan` against measured
# make bench-leave-out  time and memory of each feature: pairs of scenes with and without it
PYTHON ?= python3
PHOTONS ?= 5e7
METHODS_PHOTONS ?= 4e6
TRIES ?= 200
FUZZ_SECONDS ?= 60
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
FIGURES := fig10_forearm fig12_epidermal fig13_papillary fig14_deep
METHODS := point beam
ERROR_TIME_SCENES := configs/slab_blue.yaml configs/fig12_epidermal.yaml
SECONDS ?= 1500
PAPER_PHOTONS ?= 3.24e8
SOAK_SECONDS ?= 3600

.PHONY: setup test test-all check stability search smoke figures methods table1 error-time measured-skin lesion-table gallery \
  noise fit-tones faults fuzz soak paper-scale cross-check docs bench bench-leave-out clean $(FIGURES)

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

stability: $(INSTALLED)
	$(BIN)/skinrender check -o out/stability

search: $(INSTALLED)
	$(BIN)/pytest -q -m slow tests/system/test_any_scene.py

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
	$(BIN)/python -m skinrender.analysis.table1 out/table1/point out/table1/beam > out/table1/table1.md
	cat out/table1/table1.md

methods: $(INSTALLED)
	for scene in fig12_epidermal fig14_deep; do \
	  for method in beam point reference; do \
	    $(BIN)/skinrender render configs/$$scene.yaml --method $$method --photons $(METHODS_PHOTONS) \
	      --set 'camera.pixels=[64,64]' --set 'bands_nm={start: 400, stop: 720, step: 40}' -o out/methods/$$scene || exit; \
	  done; \
	  $(BIN)/python -m skinrender.analysis.method_pictures out/methods/$$scene out/methods/$$scene.png || exit; \
	done

paper-scale: $(INSTALLED)
	$(BIN)/python -m benchmarks.paper_scale --photons $(PAPER_PHOTONS) -o out/paper_scale

error-time: $(INSTALLED)
	$(BIN)/skinrender report $(ERROR_TIME_SCENES) --set 'camera.pixels=[64,64]' \
	  --photons 1e4 --photons 1e5 --photons 1e6 --photons 1e7 --target-seconds $(SECONDS) -o out/error_time

measured-skin: $(INSTALLED)
	$(BIN)/python -m skinrender.analysis.measured_table --set relief.kind=flat -o out/measured_skin

lesion-table: $(INSTALLED)
	$(BIN)/python -m skinrender.analysis.lesion_table

gallery: $(INSTALLED)
	$(BIN)/python -m skinrender.analysis.gallery

noise: $(INSTALLED)
	$(BIN)/python -m skinrender.analysis.noise_picture --photons $(PAPER_PHOTONS)

fit-tones: $(INSTALLED)
	$(BIN)/python -m benchmarks.fit_tones

cross-check: $(INSTALLED)
	$(BIN)/pip install --quiet --editable '.[interop]'
	$(BIN)/python -m benchmarks.cross_check

docs: $(INSTALLED)
	$(BIN)/pip install --quiet --editable '.[docs]'
	$(BIN)/mkdocs build --strict

faults: $(INSTALLED)
	for workers in 1 2; do $(BIN)/python -m tests.system.kills --workers $$workers --tries $(TRIES) || exit; done

fuzz: $(INSTALLED)
	$(BIN)/python -W ignore -m tests.system.fuzz --seconds $(FUZZ_SECONDS)

soak: $(INSTALLED)
	$(BIN)/python -m tests.system.soak --seconds $(SOAK_SECONDS)

bench: $(INSTALLED)
	$(BIN)/python -m benchmarks.walk
	$(BIN)/python -m benchmarks.estimate
	$(BIN)/python -m benchmarks.plan

bench-leave-out: $(INSTALLED)
	$(BIN)/python -m benchmarks.leave_out

clean:
	rm -rf out $(VENV)
