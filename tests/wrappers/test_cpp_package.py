"""What `cmake --install` leaves behind can be moved, found and linked in every way."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.cpp import PROJECT, build, run

pytestmark = pytest.mark.timeout(600)  # the first of them builds the library

MAIN = """\
#include <swarmwright/swarmwright.hpp>

#include <iostream>

int main() {
  const swarmwright::Parameters read("{\\"n\\": 3}");
  std::cout << swarmwright_version() << ' ' << read.integer("n", 0, 5, 1);
}
"""
LISTS = """\
cmake_minimum_required(VERSION 3.20)
project(user CXX)
find_package(swarmwright 0.1 CONFIG REQUIRED)
find_package(swarmwright 0.1 CONFIG REQUIRED)  # twice does no harm
foreach(kind swarmwright static)
  add_executable(with_${kind} main.cpp)
  target_link_libraries(with_${kind} PRIVATE swarmwright::${kind})
endforeach()
"""


def test_both_libraries_are_found_and_linked(tmp_path: Path) -> None:
    run(["cmake", "--install", build(), "--prefix", tmp_path / "first"])
    prefix = shutil.move(tmp_path / "first", tmp_path / "moved")
    (tmp_path / "main.cpp").write_text(MAIN)
    (tmp_path / "CMakeLists.txt").write_text(LISTS)
    run(["cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}"])
    run(["cmake", "--build", tmp_path / "build", "--parallel", "2"])
    for kind in ("swarmwright", "static"):
        program = tmp_path / "build" / f"with_{kind}"
        assert run([program]) == "0.1.0 3"
        needs = run(["ldd", program])
        assert ("libswarmwright.so.1" in needs) == (kind == "swarmwright")


def test_another_version_is_not_taken(tmp_path: Path) -> None:
    run(["cmake", "--install", build(), "--prefix", tmp_path / "installed"])
    (tmp_path / "CMakeLists.txt").write_text(LISTS.replace("swarmwright 0.1 ", "swarmwright 0.2 "))
    command = [
        "cmake",
        "-S",
        tmp_path,
        "-B",
        tmp_path / "build",
        f"-DCMAKE_PREFIX_PATH={tmp_path / 'installed'}",
    ]
    failed = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60, check=False)
    assert failed.returncode != 0
    assert "version: 0.1.0" in failed.stderr


@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_newer_standards_take_the_headers_without_a_warning(compiler: str, tmp_path: Path) -> None:
    (tmp_path / "main.cpp").write_text(MAIN)
    flags = ["-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    includes = [f"-I{PROJECT / 'include'}", f"-I{ROOT / 'engine' / 'bindings' / 'c' / 'include'}"]
    run([compiler, *flags, *includes, tmp_path / "main.cpp"])
