# One command each; `make` alone lists them. Everything is kept in .venv and build folders of this clone.
.DEFAULT_GOAL := help
.PHONY: help demo test bench prepare clean

# .venv is complete in itself: nothing of a sourced ROS installation or an active environment may leak in.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH AMENT_CURRENT_PREFIX CMAKE_PREFIX_PATH \
  COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH RMW_IMPLEMENTATION ROS_DISTRO VIRTUAL_ENV \
  PIP_PREFIX PIP_TARGET PIP_USER MAKEFLAGS

help:
	@echo "make demo    build what is needed, run plant and connector over ROS 2 topics, judge the run"
	@echo "make test    build what is needed, check format, lint and types, run all tests"
	@echo "make bench   build what is needed, measure everybody and draw: half an hour, into bench/"
	@echo "make prepare only build what is needed, with all tools, in .venv"
	@echo "make clean   remove .venv and everything built (recorded runs stay)"
	@echo
	@echo "PYTHON=python3.12 chooses the Python (3.10 to 3.13); ARGS=\"...\" goes to cylconn demo, bench precision or pytest."

demo:
	@sh scripts/prepare.sh demo
	@.venv/bin/cylconn demo $(ARGS)

test: prepare
	@.venv/bin/python scripts/check.py $(ARGS)

bench:
	@sh scripts/prepare.sh bench
	@mkdir -p bench
	@.venv/bin/cylconn bench precision -o bench/precision-$$(date -u +%Y%m%dT%H%M%SZ).json \
	  --pictures bench $(ARGS)
	@.venv/bin/cylconn bench model -o bench/model-$$(date -u +%Y%m%dT%H%M%SZ).json

prepare:
	@sh scripts/prepare.sh test

clean:
	rm -rf .venv build install log dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
