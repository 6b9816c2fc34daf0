PYTHON ?= python

.DEFAULT_GOAL := help
.PHONY: help install format lint type test bench docs clean-cache

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-11s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

install: ## Install in place, with everything a developer needs
	$(PYTHON) -m pip install -e ".[dev]"

format: ## Format the code and mend what can be mended
	$(PYTHON) -m ruff format .
	$(PYTHON) -m ruff check --fix .

lint: ## Check style without changing anything
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .

type: ## Check the types
	$(PYTHON) -m mypy

test: ## Run the tests
	$(PYTHON) -m pytest

bench: ## Measure every speed the README names
	$(PYTHON) scripts/benchmark.py

docs: ## Compute every table and figure of docs/results again; runs that are logged there are not repeated
	$(PYTHON) scripts/reproduce.py all

clean-cache: ## Delete compiled kernels, to compile all of them anew
	rm -rf dpsearch/__pycache__/kernels
