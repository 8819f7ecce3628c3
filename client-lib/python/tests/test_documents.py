"""The examples of the book's page and of the README are run, and the examples of the package; files of numpy go through the
command line."""

import os
import pathlib
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pairmask
import pytest
from conftest import PACKAGE, ROOT, pairmaskd, run_python

EXAMPLES = ["-m", "pairmask.examples"]
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
    ("example", "arguments", "text"),
    [
        ("worlds_batch", ["--worlds", "64", "--steps", "20"], "64 worlds of 32 boxes"),
        ("rerun_stream", ["--steps", "30", "--save", "scene.rrd"], "30 steps"),
    ],
)
def test_examples_of_the_package_run(example: str, arguments: list[str], text: str, tmp_path: Any) -> None:
    assert text in run_python(*EXAMPLES, example, *arguments, folder=tmp_path)
    if "--save" in arguments:
        assert (tmp_path / "scene.rrd").read_bytes()[:3] == b"RRF"


def test_the_demo_records_for_the_viewer(tmp_path: pathlib.Path) -> None:
    # Its python3 is this one.
    folder = pathlib.Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}
    file = tmp_path / "demo.rrd"
    command = [pairmaskd(), "demo", "--gpu", "none", "--seconds", "1", "--boxes", "300", "--rerun", str(file)]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    # A box takes 24 bytes and a color, and there are thirty frames a second.
    assert file.read_bytes()[:3] == b"RRF" and file.stat().st_size > 50_000


def test_examples_are_listed_and_a_wrong_name_is_an_error() -> None:
    listed = run_python(*EXAMPLES).splitlines()
    assert [line.split()[0] for line in listed[:2]] == ["rerun_stream", "worlds_batch"]
    assert all(len(line.split()) > 5 for line in listed[:2])
    wrong = subprocess.run([sys.executable, *EXAMPLES, "nothing"], capture_output=True, text=True, check=False)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr == "there is no example 'nothing', but rerun_stream, worlds_batch\n"


def test_an_example_whose_package_is_missing_says_how_to_install_it() -> None:
    # A module of None counts as missing.
    program = "import runpy, sys; sys.modules['rerun'] = None; sys.argv = ['x', 'rerun_stream']; "
    program += "runpy.run_module('pairmask.examples', run_name='__main__')"
    missing = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert missing.returncode == 1
    assert missing.stderr == "rerun_stream needs the package 'rerun': pip install 'pairmask[rerun]'\n"


def test_files_of_numpy_go_through_the_command_line(tmp_path: pathlib.Path) -> None:
    low = np.random.default_rng(1).random((300, 3))
    boxes = np.hstack([low, low + 0.1])
    with pairmask.Session("in-process") as session:
        expected = session.cull(boxes)
    expected = expected[np.lexsort((expected[:, 1], expected[:, 0]))]
    assert len(expected) > 100
    environment = {"PAIRMASK_RUNTIME_DIR": str(tmp_path), "PAIRMASK_GPU": "none"}
    # float64 is rounded outward here and there.
    arrays: list[tuple[str, Any]] = [("f8.npy", boxes), ("f4.npy", pairmask.outward_from_f64(boxes))]
    for name, written in arrays:
        np.save(tmp_path / name, written)
        command = [pairmaskd(), "cull", name, "--backend", "in-process", "--pairs", "pairs.npy"]
        subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=True)
        pairs = np.load(tmp_path / "pairs.npy")
        assert pairs.dtype == np.uint32 and np.array_equal(pairs, expected)
