# Two commands do it all: `make demo` and `make test`. Each sets up what it needs first.

PY := .venv/bin/python
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export PYTHONUNBUFFERED = 1
# Without kept byte code each command would compile SciPy, pandas and Numba anew: six seconds instead of one.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup dev wheel demo test compiling test-long mutants lint format bench docs clean

setup: ## the environment in .venv/
	@.ci/setup

dev: ## and what developing takes
	@.ci/setup dev

wheel: setup ## a wheel in dist/ that is whole: firmware, runtime, page, font and model inside
	$(PY) -m pip wheel -q --no-build-isolation --no-deps -w dist .

demo: setup ## tissue, fit, export, flash, stroke, estimate: the whole chain
	@.venv/bin/palpate demo

test: compiling lint ## every promise
	@.ci/setup test
	$(PY) -m pytest -n auto -m "not long" --dist loadfile --no-loadscope-reorder

compiling: dev # what the tests run compiled, while lint has the other processor
	@$(PY) -m tests.compiling &

test-long: ## the campaigns: 2000 random strokes, fuzzing, power cuts
	@.ci/setup test
	@.ci/setup bench
	PALPATE_CAMPAIGNS=docs/evidence/campaigns.jsonl $(PY) -m pytest -n 2 --dist loadfile -m long -rP --timeout 7200
	$(PY) docs/fill_reliability.py

mutants: ## faults put into the source one at a time: which do the tests notice? (hours)
	@.ci/setup test
	@.ci/setup bench
	nice $(PY) -m tests.mutants --jobs 2 --write; $(PY) docs/fill_reliability.py

lint: dev ## format, style, types, declared dependencies, spelling, prose
	$(PY) -m ruff format --check .
	$(PY) -m ruff check .
	@.ci/lint-types
	@.ci/lint-firmware
	$(PY) -m deptry host sim model_export firmware_py tests docs
	@.ci/lint-prose

format: dev
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

bench: ## speed and memory, beside the tools people would pick instead
	@.ci/setup test
	@.ci/setup bench
	$(PY) -m tests.benchmarks

docs: dev ## the documentation as a site, in site/, and how many words of it are written by hand
	@.ci/links
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict -q
	@$(PY) -m tests.docs.words | tail -1

clean:
	rm -rf .venv .links build dist site out sim/probe/wasm/node_modules host/view/fonts/node_modules .ci/docs/node_modules *.egg-info
