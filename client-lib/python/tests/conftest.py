"""Daemons and processes for tests.

Tests with a daemon need a `pairmaskd`: the one that PAIRMASKD names, else a build of this repository. They fail
where there is none, since a test that is left out tells nothing.
"""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator

import pairmask
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
# What tests wait for takes seconds at most; a hang is told after this, in seconds.
PATIENCE = 60.0


def pairmaskd() -> str:
    """The daemon's program."""
    named = os.environ.get("PAIRMASKD")
    built = [ROOT / "target" / profile / "pairmaskd" for profile in ("debug", "release")]
    for path in [named] if named else built:
        if os.path.exists(path):
            return str(path)
    pytest.fail("no pairmaskd: build it with `cargo build -p pairmaskd`, or name one in PAIRMASKD")


def wait_by_two_threads(wait: Callable[[], object]) -> tuple[list[threading.Thread], list[object]]:
    """Two threads that wait for the same, and what each got, or the kind of its error."""
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(wait())
        except pairmask.PairmaskError as error:
            ended.append(error.kind)

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    return threads, ended


class Daemon:
    """A daemon of its own directory, on the CPU."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> Daemon:
        command = [pairmaskd(), "serve", "--gpu", "none"]
        command += ["--runtime-dir", str(self.folder)]
        # A group of its own: the supervisor and its worker are killed together.
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        end = time.monotonic() + PATIENCE
        while True:
            try:
                self.session("daemon").close()
                return self
            except pairmask.ConnectError:
                assert time.monotonic() < end, "the daemon does not start"
                assert self.process.poll() is None, "the daemon has ended"
                time.sleep(0.02)

    def session(self, backend: str = "auto", **options: object) -> pairmask.Session:
        return pairmask.Session(backend, runtime_dir=self.folder, **options)  # type: ignore[arg-type]

    def kill(self) -> None:
        """Kills the supervisor and its worker at once."""
        if self.process is not None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(PATIENCE)
            self.process = None


@pytest.fixture
def daemon() -> Iterator[Daemon]:
    # A short path: sockets lie in it, whose names are 107 bytes at most.
    with tempfile.TemporaryDirectory(prefix="pm-", dir="/tmp") as folder:
        started = Daemon(pathlib.Path(folder)).start()
        yield started
        started.kill()


@pytest.fixture
def session() -> Iterator[pairmask.Session]:
    with pairmask.Session("in-process") as opened:
        yield opened


def run_python(code: str, *arguments: str) -> str:
    """Runs a program in a process of its own, and returns what it prints."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, f"{done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout
