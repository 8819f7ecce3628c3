"""Daemons, threads and processes for tests.

Tests with a daemon need a `pairmaskd`: the one that PAIRMASKD names, else a build of this repository. They fail
where there is none, since a test that is left out proves nothing.
"""

import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Self

import pairmask
import pytest

PACKAGE = pathlib.Path(__file__).resolve().parents[1]
ROOT = PACKAGE.parents[1]
# What tests wait for lasts seconds at most; a hang fails after this, in seconds.
TIMEOUT = 60.0
UNIT = [0, 0, 0, 1, 1, 1]


def pairmaskd() -> str:
    """The daemon's program."""
    named = os.environ.get("PAIRMASKD")
    built = [ROOT / "target" / profile / "pairmaskd" for profile in ("debug", "release")]
    for path in [named] if named else built:
        if os.path.exists(path):
            return str(path)
    pytest.fail("no pairmaskd: build it with `cargo build -p pairmaskd`, or name one in PAIRMASKD")


def kind_of(call: Callable[[], object], text: str | None = None) -> str:
    """The kind of the error that a call ends with, whose text matches."""
    with pytest.raises(pairmask.PairmaskError, match=text) as caught:
        call()
    return caught.value.kind


def in_threads(count: int, work: Callable[[int], object]) -> list[Any]:
    """What `work(0)`, `work(1)`, … return on a thread each, or the kinds of the errors that they end with."""
    with ThreadPoolExecutor(count) as pool:
        futures = [pool.submit(work, seed) for seed in range(count)]
    return [getattr(future.exception(), "kind", None) or future.result() for future in futures]


def count_while(work: Callable[[], object]) -> tuple[int, float]:
    """How often a loop of Python ran on another thread while `work` did, and how long that took."""
    done = threading.Event()
    counted = 0

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1

    thread = threading.Thread(target=count)
    thread.start()
    began = time.perf_counter()
    work()
    took = time.perf_counter() - began
    done.set()
    thread.join()
    return counted, took


class Daemon:
    """A daemon of its own directory, on the CPU."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> Self:
        command = [pairmaskd(), "serve", "--gpu", "none", "--runtime-dir", self.folder]
        # A group of its own: the supervisor and its worker are killed together.
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        end = time.monotonic() + TIMEOUT
        while True:
            try:
                self.session("daemon").close()
                return self
            except pairmask.ConnectError:
                assert time.monotonic() < end, "the daemon does not start"
                assert self.process.poll() is None, "the daemon has ended"
                time.sleep(0.02)

    def session(self, backend: str = "daemon", **options: object) -> pairmask.Session:
        return pairmask.Session(backend, runtime_dir=self.folder, **options)  # type: ignore[arg-type]

    def kill(self) -> None:
        """Kills the supervisor and its worker at once."""
        if self.process is not None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(TIMEOUT)
            self.process = None


@pytest.fixture
def daemon() -> Iterator[Daemon]:
    # A short path: sockets lie in it, whose names are 107 bytes at most.
    with tempfile.TemporaryDirectory(prefix="pm-", dir="/tmp") as folder:
        started = Daemon(folder).start()
        yield started
        started.kill()


@pytest.fixture
def session() -> Iterator[pairmask.Session]:
    with pairmask.Session("in-process") as opened:
        yield opened


def run_python(*arguments: str, folder: pathlib.Path | None = None) -> str:
    """Runs Python in a process of its own, in a folder, and returns what it prints."""
    command = [sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, cwd=folder, check=False)
    assert done.returncode == 0, f"{done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout
