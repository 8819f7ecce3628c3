"""The type stubs are those of the package that is installed, and the tests are typed by them."""

import pytest
from conftest import PACKAGE, run_python

MYPY = ["mypy", "--config-file", "pyproject.toml"]


@pytest.mark.parametrize(
    "module",
    [
        ["mypy.stubtest", "--mypy-config-file", "pyproject.toml", "pairmask"],
        [*MYPY, "-p", "pairmask.examples"],
        *([*MYPY, folder] for folder in ("tests", "../c/benches")),
    ],
)
def test_stubs_and_types(module: list[str]) -> None:
    run_python("-m", *module, folder=PACKAGE)
