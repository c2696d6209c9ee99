# Both commands set up what they need; nothing has to be there before but Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
DEMO := demo-results
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: demo test test-slow lint docs smoke lowest newest install lock clean

install: $(VENV)/.installed

# torch first and by itself: its CPU build on Linux without an NVIDIA driver, where that of the
# package index has CUDA, which is three times as large. TORCH=torch==2.13.0 asks for CUDA.
# Where PyTorch's index can't be reached, the package index is enough: one retry, then on.
DRIVER := $(wildcard /proc/driver/nvidia/version /dev/nvidiactl /dev/dxg)
CPU_INDEX := --retries 1 --extra-index-url https://download.pytorch.org/whl/cpu
TORCH ?= torch==2.13.0 $(if $(DRIVER),,$(if $(filter Linux,$(shell uname -s)),$(CPU_INDEX)))
$(VENV)/.installed: pyproject.toml requirements.lock
	$(PYTHON) -m venv $(VENV)
	$(PIP) install $(TORCH)
	$(PIP) install --no-deps --require-hashes --requirement requirements.lock
	$(PIP) install --no-deps --editable .
	touch $@

# The lock of what install installs, for all systems; versions stay where they still fit, and
# UPGRADE=--upgrade takes the newest ones.
# torch is left out: CPU or CUDA is the machine's choice.
lock: install
	$(PIP) install uv
	echo "torch; sys_platform == 'none'" > $(VENV)/no-torch.txt
	$(BIN)/uv pip compile pyproject.toml --extra dev --extra docs --extra render --universal \
		--overrides $(VENV)/no-torch.txt --no-emit-package torch --generate-hashes \
		--no-annotate --custom-compile-command "make lock" $(UPGRADE) \
		--output-file requirements.lock

# The whole pipeline, small, with the commands that a user types.
demo: install
	@$(BIN)/jbench demo --results $(DEMO)

# More processes than cores: tests often wait for commands that they have started.
test: install
	$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

# What `test` leaves out because it takes many minutes.
test-slow: install
	$(BIN)/python -m pytest --numprocesses 2 --dist load -m slow

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/size.py
	$(BIN)/python tests/questions.py
	$(BIN)/python -m tests.words

# The site, in build/site; it opens without a server.
docs: install
	$(BIN)/python docs/build_site.py

# For other systems and versions of Python: builds the wheel, and drives it by itself.
smoke:
	$(PYTHON) -m venv $(VENV)
	$(PIP) install $(TORCH)
	$(PIP) install . hypothesis pytest setuptools
	$(BIN)/python -m pytest tests/test_distribution.py -m "slow or not slow"

# The tests with the lowest versions that pyproject.toml permits.
lowest:
	$(PYTHON) -m venv $(VENV)
	$(PIP) install $(TORCH)
	$(PIP) install uv
	$(BIN)/uv pip install --python $(BIN)/python --resolution lowest-direct --editable '.[test]'
	$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

# The fast tests with the newest versions that pyproject.toml permits.
newest:
	$(PYTHON) -m venv $(VENV)
	$(PIP) install torch $(if $(DRIVER),,$(CPU_INDEX))
	$(PIP) install --upgrade --editable '.[test]'
	$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

clean:
	rm -rf $(VENV) $(DEMO)
