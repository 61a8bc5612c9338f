# Two commands do everything on a machine that has Python, pip and make: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# One BLAS thread per process: more only get in each other's way on the small systems solved here.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test test-all lint types format lock benchmark operating-characteristic operating-characteristic-zener operating-characteristic-hmi operating-characteristic-hmi-linear real-measurements calibration clean

demo: $(VENV)/.run  ## the main job, on the paper's own case and on real measurements
	$(BIN)/arfjax fit-dma $$($(BIN)/arfjax data pyvisco_polymer) --out results/demo/dma
	$(BIN)/arfjax fit-dma $$($(BIN)/arfjax data nist_foam) --out results/demo/dma_foam
	$(BIN)/arfjax infer --dma $$($(BIN)/arfjax data pyvisco_polymer) --temperature 60 --draws 500 --out results/demo/infer
	$(BIN)/arfjax diagnose --dma $$($(BIN)/arfjax data pyvisco_polymer) --model zener --out results/demo/diagnose_dma
	$(BIN)/arfjax diagnose examples/suomi2016_published.toml --hmi $$($(BIN)/arfjax data suomi2016_hmi) --out results/demo/diagnose_hmi
	$(BIN)/arfjax field examples/five_layers.toml --out results/demo/field
	$(BIN)/arfjax simulate examples/suomi2016.toml --out results/demo/simulate
	$(BIN)/arfjax push examples/suomi2016.toml --out results/demo/push
	$(BIN)/arfjax vibrate examples/suomi2016.toml --out results/demo/vibrate
	$(BIN)/arfjax sonicate examples/suomi2016.toml --out results/demo/sonicate
	$(BIN)/arfjax fit-heating $$($(BIN)/arfjax data mr_hifu_60s) --out results/demo/heating
	$(BIN)/arfjax calibrate examples/suomi2016.toml --hmi $$($(BIN)/arfjax data suomi2016_hmi) --out results/demo/calibrate
	$(BIN)/arfjax reproduce --out results/demo/reproduce
	@echo
	@echo "Reports and figures:"
	@ls -d results/demo/*/report.md results/demo/*/*.png

# Most of the time of fast tests is that of compiling: here programs are compiled in haste, and run slower. All tests
# (`make test-all`), the demo and benchmarks have them compiled as users do.
test: export JAX_DISABLE_MOST_OPTIMIZATIONS := 1
test: export XLA_FLAGS := --xla_cpu_use_fusion_emitters=false
test: lint types  ## what must be true before a change lands
	$(BIN)/python -m pytest -n 2 --dist loadscope -m "not slow"

test-all: lint types  ## the slow tests, too: before an issue is closed or a version released
	$(BIN)/python -m pytest -n 2 --dist loadscope

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/basedpyright --pythonpath $(BIN)/python

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

benchmark: $(VENV)/.run  ## the numbers of README: errors and times, as JSON
	$(BIN)/python -m benchmarks.accuracy --out results/benchmarks/accuracy.json
	$(BIN)/python -m benchmarks.acoustics --out results/benchmarks/acoustics.json
	$(BIN)/python -m benchmarks.chain --out results/benchmarks/chain.json
	$(BIN)/python -m benchmarks.mechanics --out results/benchmarks/mechanics.json
	$(BIN)/python -m benchmarks.protocols --out results/benchmarks/protocols.json
	$(BIN)/python -m benchmarks.inference --out results/benchmarks/inference.json
	$(BIN)/python -m benchmarks.thermal --out results/benchmarks/thermal.json
	$(BIN)/python -m benchmarks.diagnosis_speed --out results/benchmarks/diagnosis_speed.json

# Rates of the diagnosis, each page by one command, WORKERS data sets at a time. A study goes on where it was stopped,
# and begins again where the code has changed: choose new seeds first (FIRST_TEST_SEED) if the old ones changed it.
# QUICK=1: minutes, and pages into results/docs.
WORKERS ?= 2
STUDY := --workers $(WORKERS) --docs $(if $(QUICK),results/docs,docs) --anew
RECORDS := $(if $(QUICK),results/quick,benchmarks/records)
DETECTION := $(if $(QUICK),true,$(BIN)/python -m benchmarks.diagnosis_detection --workers $(WORKERS))

operating-characteristic: $(VENV)/.run  ## docs/operating_characteristic.md, in two hours
	$(BIN)/python -m benchmarks.diagnosis $(STUDY) --out $(RECORDS)/diagnosis.jsonl $(if $(QUICK),--quick)
	$(DETECTION)

operating-characteristic-zener: $(VENV)/.run  ## the same for the conventional model
	$(BIN)/python -m benchmarks.diagnosis --model zener $(STUDY) --out $(RECORDS)/diagnosis_zener.jsonl $(if $(QUICK),--quick)
	$(DETECTION) --model zener

operating-characteristic-hmi-linear: $(VENV)/.run  ## the same for displacement, on linear data, in three quarters of an hour
	$(BIN)/python -m benchmarks.diagnosis_hmi_fast $(filter-out --anew,$(STUDY)) --out $(if $(QUICK),results/quick,results/benchmarks)/diagnosis_hmi_fast.json --share $(if $(QUICK),0.05,0.5)

operating-characteristic-hmi: $(VENV)/.run  ## the same on simulated data, two hours a round
	$(BIN)/python -m benchmarks.diagnosis_hmi $(STUDY) --out $(RECORDS)/diagnosis_hmi.jsonl $(if $(QUICK),--minutes 15)
	$(if $(QUICK),,$(BIN)/python -m benchmarks.diagnosis_intervals --workers $(WORKERS))

real-measurements: $(VENV)/.run  ## docs/real_measurements.md, in a quarter of an hour
	$(BIN)/python -m benchmarks.real_data --docs docs --workers $(WORKERS)

calibration: $(VENV)/.run  ## docs/calibration.md, in three quarters of an hour; goes on where it was stopped
	$(BIN)/python -m benchmarks.calibration --out results/benchmarks/calibration.json --docs docs

lock: $(VENV)/.dev  ## newest versions that fit pyproject.toml, for every Python and platform
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes --no-header \
		--no-emit-index-url pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes --no-header \
		--no-emit-index-url pyproject.toml --extra dev -c requirements.lock -o requirements-dev.lock

$(VENV)/.run: requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

$(VENV)/.dev: requirements-dev.lock $(VENV)/.run
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-dev.lock
	touch $@

clean:
	rm -rf $(VENV) results build dist *.egg-info .pytest_cache .ruff_cache
