"""The examples of the book's page and of the README are run, and the example programs."""

import pathlib
import re
from typing import Any

import pytest
from conftest import PACKAGE, ROOT, run_python

PAGES = [ROOT / "client-lib/book/src/start-python.md", PACKAGE / "README.md"]


def blocks_of(page: pathlib.Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(("page", "count"), [(PAGES[0], 4), (PAGES[1], 1)])
def test_examples_of_pages_run(
    page: pathlib.Path, count: int, monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    # No daemon of this machine's user answers.
    monkeypatch.setenv("PAIRMASK_RUNTIME_DIR", str(tmp_path))
    printed = [run_python("-c", block).splitlines() for block in blocks_of(page)]
    assert len(printed) == count
    if page == PAGES[0]:
        # As on the page.
        assert printed[0][0] == "served by in-process" and len(printed[0]) == 4


def test_the_page_installs_this_package() -> None:
    shell = re.findall(r"^```sh\n(.*?)^```", PAGES[0].read_text(), re.DOTALL | re.MULTILINE)
    named = re.search(r"pip install \./(\S+)", shell[0])
    assert named is not None and (ROOT / named[1] / "pyproject.toml").exists()


@pytest.mark.parametrize(
    ("program", "arguments", "text"),
    [
        ("worlds_batch.py", ["--worlds", "64", "--steps", "20"], "64 worlds of 32 boxes"),
        ("rerun_stream.py", ["--steps", "30", "--save", "scene.rrd"], "30 steps"),
    ],
)
def test_example_programs_run(program: str, arguments: list[str], text: str, tmp_path: Any) -> None:
    assert text in run_python(str(PACKAGE / "examples" / program), *arguments, folder=tmp_path)
    if "--save" in arguments:
        assert (tmp_path / "scene.rrd").read_bytes()[:3] == b"RRF"
