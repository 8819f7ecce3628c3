"""What the rows were measured on."""

import platform
import shlex
import subprocess
import sys
from importlib import metadata
from pathlib import Path


def _gpu():
    query = "--query-gpu=name,driver_version"
    try:
        done = subprocess.run(
            ["nvidia-smi", query, "--format=csv,noheader"], check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return {"gpu": None, "driver": None}
    name, driver = done.stdout.splitlines()[0].split(", ")
    return {"gpu": name, "driver": driver}


def _version(package):
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _command():
    """The command line, without the folders of the user who ran it."""
    arguments = [Path(text).name if text.startswith("/") else text for text in sys.argv[1:]]
    return shlex.join(["python3", "tests/gpu_peers", *arguments])


def of(pairmaskd_machine, pairmaskd_version, script_commit):
    """The machine as `pairmaskd` names it, and what the peers stand on."""
    ours = {key: pairmaskd_machine[key] for key in ("cpu", "cores", "os", "kernel", "toolchain", "commit")}
    return ours | _gpu() | {
        "pairmaskd": pairmaskd_version,
        "python": platform.python_version(),
        "numpy": _version("numpy"),
        "warp": _version("warp-lang"),
        "newton": _version("newton"),
        "script_commit": script_commit,
        "command": _command(),
    }
