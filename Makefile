# Python 3.11, git and make are all that setup, learn and test need.
PYTHON ?= python3.11
OUT ?= runs/learn
BIN = .venv/bin

.PHONY: setup learn cpp test lint bench

setup: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all]'
	touch $@

# Trains the default agent, or goes on where an interrupted `make learn` stopped.
learn: setup
	@if [ -f $(OUT)/checkpoint.pt ]; then $(BIN)/dntorch learn --resume $(OUT); \
	else $(BIN)/dntorch learn --out $(OUT); fi

# Builds the C++ runner (CMake and a C++ compiler are needed, too) and lets it replay and drive
# an export; makes one of OUT if need be.
EXPORT ?= runs/export
$(EXPORT)/manifest.json: $(wildcard $(OUT)/checkpoint.pt)
	$(BIN)/dntorch export $(OUT) --to $(EXPORT)

cpp: setup $(EXPORT)/manifest.json
	cmake -S examples/cpp -B build/cpp \
		-DCMAKE_PREFIX_PATH="$$($(BIN)/python -c 'import torch; print(torch.utils.cmake_prefix_path)')"
	cmake --build build/cpp
	build/cpp/run_agent $(EXPORT)

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest --no-unlisted-skips -n 2 --dist loadfile

# Speed, as ratios inside one run: under ten minutes on an idle machine.
bench: setup
	$(BIN)/python benchmarks/core.py
	$(BIN)/python benchmarks/pixels.py
	$(BIN)/python benchmarks/ring.py
	$(BIN)/python benchmarks/loop.py
	$(BIN)/python benchmarks/behaviors.py

lint: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
