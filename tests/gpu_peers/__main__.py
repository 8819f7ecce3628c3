"""Whole frames of Pairmask, NVIDIA Warp and Newton on one machine; see README.md."""

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import machine
import report
from pairmask import Pairmask

HERE = Path(__file__).parent
CONTENDERS = (
    "warp-refit,warp-rebuild,warp-cubql-refit,warp-cubql-rebuild,newton-all-pairs,newton-sap"
)


def names(text):
    return [] if text == "none" else text.split(",")


def sizes(text):
    return [int(number) for number in text.split(",")]


def parse():
    parser = argparse.ArgumentParser(prog="gpu_peers", description=__doc__)
    parser.add_argument("--pairmaskd", required=True, help="binary of a release build")
    parser.add_argument("--out", required=True, type=Path, help="folder for gpu_peers.json and .md")
    parser.add_argument("--device", default="cuda:0", help="Warp's device; cpu only rehearses")
    parser.add_argument("--scene", type=names, default=names("uniform,mixed,pile,plane"))
    parser.add_argument("--n", type=sizes, default=sizes("1000,10000,100000,1000000"))
    parser.add_argument("--contenders", type=names, default=names(CONTENDERS), help="peers, or none")
    parser.add_argument("--frames", type=int, default=40, help="frames whose total is timed")
    parser.add_argument("--warm-up", type=int, default=20, help="frames before those")
    parser.add_argument("--split-frames", type=int, default=20, help="frames after, timed by stage")
    parser.add_argument(
        "--decode-threads",
        type=sizes,
        default=sizes("1,8"),
        help="threads of Pairmask's client, each number a row; peers' lists are iterated over by one",
    )
    parser.add_argument("--commit", help="of this script, where it is run outside its repository")
    return parser.parse_args()


def commit():
    done = subprocess.run(
        ["git", "-C", HERE, "rev-parse", "--short", "HEAD"], check=False, capture_output=True, text=True
    )
    return done.stdout.strip() or None


def our_row(pairmask, name, ours, scene_name, n, boxes, options):
    """A row of ours, and the machine as `pairmaskd` names it."""
    row = {"contender": name, "scene": scene_name, "n": n}
    backend, threads = ours
    try:
        found, timed = pairmask.latency(boxes, backend, options.frames, options.warm_up, threads)
    except RuntimeError as error:
        return None, row | {"error": str(error)}
    return found, row | report.our_times(timed)


def peer_rows(contender, files, options):
    """The rows of one peer, measured in a process of its own."""
    command = [sys.executable, HERE / "measure.py", "--contender", contender]
    command += ["--device", options.device, "--pairmaskd", options.pairmaskd]
    command += ["--frames", options.frames, "--warm-up", options.warm_up]
    command += ["--split-frames", options.split_frames]
    command += [f"{scene}={path}" for (scene, _), path in files.items()]
    done = subprocess.run(list(map(str, command)), check=False, stdout=subprocess.PIPE, text=True)
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    measured = {(row["scene"], row["n"]) for row in rows}
    # A process that died has no row for the scene it died on, nor for those after it.
    for scene, n in files:
        if (scene, n) not in measured:
            error = f"its process ended with status {done.returncode}"
            rows.append({"contender": contender, "scene": scene, "n": n, "error": error})
    return rows


def our_rows(pairmask, files, options):
    """All rows of ours, and the machine as `pairmaskd` names it; None where it answered none."""
    rows, found_machine = [], None
    for (scene, n), boxes in files.items():
        for ours in itertools.product(("daemon", "in-process"), options.decode_threads):
            name = report.our_name(*ours)
            found, row = our_row(pairmask, name, ours, scene, n, boxes, options)
            found_machine = found or found_machine
            rows.append(row)
            print(f"{scene} {n} {name}: {row['error'] or row['total_ms']}", flush=True)
    return rows, found_machine


def save(options, pairmask, rows, found_machine, order):
    """What is measured so far: a run that is cut short keeps it."""
    rows = sorted(rows, key=lambda row: order[row["scene"], row["n"]])
    result = {
        "machine": machine.of(found_machine, pairmask.version(), options.commit or commit()),
        "rows": rows,
        "ratios": report.ratios(rows),
    }
    (options.out / "gpu_peers.json").write_text(json.dumps(result, indent=1) + "\n")
    (options.out / "gpu_peers.md").write_text(report.markdown(result))


def main():
    options = parse()
    options.out.mkdir(parents=True, exist_ok=True)
    pairmask = Pairmask(options.pairmaskd)
    with tempfile.TemporaryDirectory() as folder:
        files = {}
        for n in options.n:
            for scene in options.scene:
                files[scene, n] = Path(folder) / f"{scene}-{n}.f32"
                pairmask.write_scene(scene, n, files[scene, n])
        order = {setting: slot for slot, setting in enumerate(files)}
        rows, found_machine = our_rows(pairmask, files, options)
        if found_machine is None:
            sys.exit("gpu_peers: Pairmask answered no frame: " + rows[0]["error"])
        save(options, pairmask, rows, found_machine, order)
        for contender in options.contenders:
            for row in peer_rows(contender, files, options):
                rows.append(row)
                text = row["error"] or f"{row['total_ms']}, exact: {report.is_exact(row)}"
                print(f"{row['scene']} {row['n']} {contender}: {text}", flush=True)
            save(options, pairmask, rows, found_machine, order)


if __name__ == "__main__":
    main()
