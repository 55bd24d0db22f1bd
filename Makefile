# Targets of this repository; `make` alone lists them. They write only to .venv and build folders of this clone.
.DEFAULT_GOAL := help
.PHONY: help demo test bench docs prepare clean

# .venv is self-contained: variables of a sourced ROS installation or an active environment must not affect it.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH AMENT_CURRENT_PREFIX CMAKE_PREFIX_PATH \
  COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH RMW_IMPLEMENTATION ROS_DISTRO VIRTUAL_ENV \
  PIP_PREFIX PIP_TARGET PIP_USER MAKEFLAGS

help:
	@echo "make demo     run plant and connector over ROS 2 topics and check the recorded run"
	@echo "make test     check format, lint and types, run all tests"
	@echo "make bench    measure everything, planned 40 minutes; results in bench/, tables and pictures in docs/"
	@echo "make docs     build the documentation site into build/docs"
	@echo "make prepare  only install what the others need, with all tools, into .venv"
	@echo "make clean    remove .venv and everything built (recorded runs stay)"
	@echo
	@echo "Each target installs what it needs into .venv; 'source .venv/bin/activate' puts cylconn on your PATH."
	@echo "PYTHON=python3.12 selects the Python (3.10 to 3.13); ARGS=\"...\" goes to cylconn demo, bench all or pytest."

demo:
	@sh scripts/prepare.sh demo
	@.venv/bin/cylconn demo $(ARGS)

test: prepare
	@.venv/bin/python scripts/check.py $(ARGS)

bench:
	@sh scripts/prepare.sh bench
	@.venv/bin/cylconn bench all --document docs --pictures docs/pictures $(ARGS)

docs:
	@sh scripts/prepare.sh docs
	@.venv/bin/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "open build/docs/index.html"

prepare:
	@sh scripts/prepare.sh test

clean:
	rm -rf .venv build install log dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
