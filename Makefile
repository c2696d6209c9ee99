# Both commands set up what they need; nothing has to be there before but Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := demo-results
PIP := $(BIN)/pip --disable-pip-version-check --quiet

.PHONY: demo test lint install clean

install: $(VENV)/.installed

# torch first and by itself, so that a machine without a GPU gets its CPU build where the index
# has one; TORCH="torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu" asks for it.
TORCH ?= torch==2.13.0
$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) install $(TORCH)
	$(PIP) install --constraint constraints.txt --editable '.[dev,render]'
	touch $@

# The whole pipeline, small: smaller networks and fewer random first steps than the paper's TD3, so
# that it learns within minutes. The commands are those that a user types.
SMALLER := --set hidden_layers=[128,128] --set learning_rate=1e-3 --set learning_starts=5000
AGENTS := --algo td3 --seeds 0-1 --steps 30000 $(SMALLER) --evaluate-episodes 5
demo: install
	@echo "jbench demo: TD3 on face_direction, full and encoded, 2 seeds; networks of [128, 128]"
	@echo "instead of the paper's [350, 250], 30,000 steps instead of 5,000,000."
	$(BIN)/jbench collect --steps 50000 --results $(DEMO)
	$(BIN)/jbench train-dae --latent 12 --epochs 100 --batch 256 --results $(DEMO)
	$(BIN)/jbench train $(AGENTS) --encoder none --results $(DEMO)
	$(BIN)/jbench train $(AGENTS) --encoder 12 --results $(DEMO)
	$(BIN)/jbench report --window 5 --results $(DEMO)
	@echo
	@echo "The report: $(DEMO)/report/index.html (curves: $(DEMO)/report/figure9.png)"
	@echo "Next, the paper's experiment on one task (it takes days; --steps and --seeds ask for less):"
	@echo "  $(BIN)/jbench collect && $(BIN)/jbench train-dae &&"
	@echo "  $(BIN)/jbench train --algo ddpg --encoder 12 && $(BIN)/jbench report"

test: install
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) $(DEMO)
