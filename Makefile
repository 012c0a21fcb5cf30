# Everything a person needs: `make demo` shows the whole job, `make test` proves it. Both set up .venv themselves.

PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3.13 || command -v python3)
BIN := .venv/bin
OUT ?= demo-out
WORKERS ?= 2

.PHONY: demo test bench soak docs pictures accuracy setup setup-test system-test lint clean

demo: setup  ## the whole job on the simulated rig; results in $(OUT)
	@$(BIN)/microrelief demo --out $(OUT)

test: setup-test lint  ## lint, types, import contracts and every test
	$(BIN)/pytest -n $(WORKERS) --dist loadfile -m "not soak" -q

lint: setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup-test  ## performance ratios: ours, the peer, the physical floor
	$(BIN)/python -m tests.benchmarks

soak: setup-test  ## long runs: many kills, days of campaign, endurance
	$(BIN)/pytest -m soak -q -s

docs: setup-test  ## the documentation as a site, in docs/_build
	@$(BIN)/python -m sphinx -q -W docs docs/_build
	@echo "open docs/_build/index.html in a browser"

pictures: setup-test demo  ## the pictures of README and docs
	$(BIN)/python -m tests.dashboards.take_screenshot $(OUT)/review.rrd docs/images/review.png
	$(BIN)/python -m tests.pipelines.change.draw_curl  # docs/images/curl.svg

accuracy: setup-test  ## run what measures accuracy and write docs/accuracy.md: half an hour
	$(BIN)/python -m tests.benchmarks.accuracy_page docs/accuracy.md

setup: .venv/installed
setup-test: .venv/installed-test system-test

.venv/bin/python:
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed: install python3.11 and python3.11-venv"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed, $(PYTHON) is older: make PYTHON=/path/to/python3.11"; exit 1; }
	@echo "setting up .venv with $(PYTHON)"
	@$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml constraints.txt
	@echo "installing microrelief and what it needs (about 1.8 GB, a few minutes the first time)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

.venv/installed-test: .venv/installed
	@echo "installing what the tests need"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

system-test:
	@sh .ci/system-packages
	@sh .ci/node-packages
	@sh .ci/octoprint
	@sh .ci/gige

clean:
	rm -rf .venv demo-out docs/_build docs/reference build dist
