"""The type stubs are those of the package that is installed, and the tests are typed by them."""

import pathlib
import subprocess
import sys

TESTS = pathlib.Path(__file__).parent


def run(*arguments: str) -> None:
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=TESTS, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_stubs_are_what_there_is() -> None:
    run("mypy.stubtest", "pairmask")


def test_tests_and_examples_are_typed() -> None:
    for folder in (".", "../examples", "../../c/benches"):
        run("mypy", "--config-file", "../pyproject.toml", folder)
