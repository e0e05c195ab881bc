"""The C++ wrapper's own tests, under each sanitizer."""

import shutil

import pytest

from tests.cpp import SANITIZED, run, sanitized

pytestmark = pytest.mark.timeout(600)


@pytest.mark.parametrize("sanitizer", SANITIZED)
def test_units(sanitizer: str) -> None:
    ctest = shutil.which("ctest")
    assert ctest
    said = run([ctest, "--test-dir", sanitized(sanitizer), "--output-on-failure"])
    assert "100% tests passed, 0 tests failed out of 4" in said
