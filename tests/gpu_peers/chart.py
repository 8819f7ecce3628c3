"""The README's chart: whole frames of the GPU record and of the records of `--bench peers`, as SVG.

    python3 tests/gpu_peers/chart.py --gpu tests/records/2026-11-22-h200/gpu_peers.json \\
        --cpu tests/records/2026-11-21-epyc-2-cores/peers.jsonl \\
        --cpu tests/records/2026-11-21-epyc-2-cores/peers-million.jsonl \\
        --cpu-name "AMD EPYC, 2 cores, no GPU" --calibrated --out tests/records/whole-frames.svg
"""

import argparse
import json
import math
from dataclasses import dataclass
from html import escape
from pathlib import Path


# Narrow, so that a phone shows it at nearly its own size. Pixels.
WIDTH, PLOT_LEFT, PLOT_RIGHT = 420, 48, 272
TITLE_HEIGHT, PLOT_HEIGHT, FOOT_HEIGHT = 100, 220, 58
# Between two labels at the ends of lines.
LABEL_STEP = 32
# Mid tones: an image cannot know whether the page around it is light or dark.
INK, FAINT = "#77808a", "#77808a55"
COLOURS = {"daemon": "#2f81f7", "in process": "#c77b0a", "best peer": "#77808a"}
NAMES = {
    "newton-all-pairs": "Newton all pairs",
    "newton-sap": "Newton sweep",
    "warp-refit": "Warp refit",
    "warp-rebuild": "Warp rebuild",
    "warp-cubql-refit": "Warp cuBQL refit",
    "warp-cubql-rebuild": "Warp cuBQL rebuild",
    "parry-optimize": "parry3d refit + optimise",
    "parry-refit": "parry3d refit",
}


@dataclass
class Panel:
    """One machine: for each line, ms by number of boxes; and who the best peer was where."""

    title: str
    lines: dict
    peers: dict


def gpu_panel(path, scene, is_calibrated):
    """Rows of `gpu_peers.json`: Pairmask as it comes, or after `pairmaskd calibrate`."""
    suffix = "-calibrated" if is_calibrated else ""
    record = json.loads(path.read_text())
    machine = record["machine"]
    ratios = [row for row in record["ratios"] if row["scene"] == scene]
    lines, peers = {name: {} for name in COLOURS}, {}
    for row in ratios:
        for line, backend in (("daemon", "daemon"), ("in process", "in-process")):
            if row["ours"] == f"pairmask-{backend}{suffix}":
                lines[line][row["n"]] = row["ours_ms"]
        lines["best peer"][row["n"]] = row["best_peer_ms"]
        peers[row["n"]] = row["best_peer"]
    return Panel(f"{machine['gpu']}, {machine['cores']} cores; {scene} scene", lines, peers)


def cpu_panel(paths, scene, name):
    """Rows of `peers.jsonl`, of the most threads there are."""
    rows = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    rows = [row for row in rows if row["scene"] == scene]
    threads = max(row["threads"] for row in rows)
    lines, peers = {line: {} for line in COLOURS}, {}
    for row in rows:
        if row["threads"] != threads or not row["pairs_equal"]:
            continue
        n, peer_ms = row["n"], row["peer_ns"] / 1e6
        lines[row["backend"].replace("-", " ")][n] = row["ours_ns"] / 1e6
        if peer_ms <= lines["best peer"].get(n, math.inf):
            lines["best peer"][n], peers[n] = peer_ms, row["peer"]
    return Panel(f"{name}; {scene} scene", lines, peers)


def number(ms):
    """Two digits that mean something."""
    digits = max(0, 1 - math.floor(math.log10(ms)))
    return f"{ms:.{digits}f}"


def best_peers(peers):
    """Who was the best peer where, a line a change."""
    runs = []
    for n in sorted(peers):
        if not runs or runs[-1][0] != peers[n]:
            runs.append((peers[n], n))
    names = [f"{NAMES.get(name, name)} from {n:,} boxes on" for name, n in runs]
    return [f"Best peer: {names[0]}", *(f"then {name}" for name in names[1:])]


def spread(slots, step, low, high):
    """Heights for labels in order, at least `step` apart and near where they belong."""
    order = sorted(range(len(slots)), key=lambda i: slots[i])
    heights = [min(max(slots[i], low), high) for i in order]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + step)
    overflow = max(0, heights[-1] - high)
    heights[-1] -= overflow
    for i in range(len(heights) - 2, -1, -1):
        heights[i] = min(heights[i], heights[i + 1] - step)
    result = [0.0] * len(slots)
    for i, height in zip(order, heights, strict=True):
        result[i] = height
    return result


def text(x, y, words, anchor="start", size=13, colour=INK, weight=400):
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="{anchor}" font-size="{size}" '
        f'fill="{colour}" font-weight="{weight}">{escape(words)}</text>'
    )


def draw(panel, top, decades, sizes):
    """The elements of one panel whose upper edge is at `top`."""
    first, last = decades
    plot_top = top + TITLE_HEIGHT
    bottom = plot_top + PLOT_HEIGHT

    def x(n):
        share = math.log(n / sizes[0]) / math.log(sizes[-1] / sizes[0])
        return PLOT_LEFT + share * (PLOT_RIGHT - PLOT_LEFT)

    def y(ms):
        return bottom - (math.log10(ms) - first) / (last - first) * PLOT_HEIGHT

    parts = [text(8, top + 26, panel.title, size=15, weight=600)]
    for slot, line in enumerate(best_peers(panel.peers)):
        parts.append(text(8, top + 45 + 16 * slot, line, size=12))
    parts.append(text(8, plot_top - 12, "ms a frame (log scale; lower is better)", size=12))
    for decade in range(math.ceil(first), math.floor(last) + 1):
        height = y(10**decade)
        parts.append(
            f'<path d="M{PLOT_LEFT} {height:.1f}H{PLOT_RIGHT}" stroke="{FAINT}" fill="none"/>'
        )
        parts.append(text(PLOT_LEFT - 8, height + 4, f"{10.0**decade:g}", "end"))
    for n in sizes:
        parts.append(f'<path d="M{x(n):.1f} {plot_top}V{bottom}" stroke="{FAINT}" fill="none"/>')
        label = f"{n // 1_000_000} M" if n >= 1_000_000 else f"{n:,}"
        parts.append(text(x(n), bottom + 20, label, "middle"))
    parts.append(text((PLOT_LEFT + PLOT_RIGHT) / 2, bottom + 40, "boxes", "middle", 12))
    ends = []
    for name, colour in COLOURS.items():
        points = sorted(panel.lines[name].items())
        path = "L".join(f"{x(n):.1f} {y(ms):.1f}" for n, ms in points)
        dash = ' stroke-dasharray="7 4"' if name == "best peer" else ""
        parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="2.5"{dash}/>')
        parts += [f'<circle cx="{x(n):.1f}" cy="{y(ms):.1f}" r="3.5" fill="{colour}"/>' for n, ms in points]
        ends.append((name, colour, points[-1][1]))
    heights = spread([y(ms) for _, _, ms in ends], LABEL_STEP, plot_top + 8, bottom - 18)
    for (name, colour, ms), height in zip(ends, heights, strict=True):
        who = "best peer" if name == "best peer" else f"Pairmask {name}"
        parts.append(text(PLOT_RIGHT + 9, height, who, size=12, colour=colour, weight=600))
        parts.append(text(PLOT_RIGHT + 9, height + 14, f"{number(ms)} ms", size=12, colour=colour))
    return parts


def chart(panels):
    """The SVG file."""
    values = [ms for panel in panels for line in panel.lines.values() for ms in line.values()]
    # The same scale for all, with a little air.
    decades = (math.log10(0.7 * min(values)), math.log10(1.4 * max(values)))
    sizes = sorted(
        {n for panel in panels for line in panel.lines.values() for n in line}
        & {10**power for power in range(10)}
    )
    panel_height = TITLE_HEIGHT + PLOT_HEIGHT + FOOT_HEIGHT
    height = panel_height * len(panels)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'height="{height}" font-family="system-ui, sans-serif" role="img">',
        "<title>Whole frames by number of boxes: Pairmask and the best peer</title>",
    ]
    for slot, panel in enumerate(panels):
        parts += draw(panel, slot * panel_height, decades, sizes)
    return "\n".join([*parts, "</svg>"]) + "\n"


def main():
    parser = argparse.ArgumentParser(description="The README's chart of whole frames, as SVG")
    parser.add_argument("--gpu", required=True, type=Path, help="gpu_peers.json")
    parser.add_argument("--cpu", required=True, type=Path, action="append", help="peers.jsonl")
    parser.add_argument("--cpu-name", required=True, help="machine of those")
    parser.add_argument("--scene", default="uniform")
    parser.add_argument("--calibrated", action="store_true", help="the GPU's rows after calibration")
    parser.add_argument("--out", required=True, type=Path)
    options = parser.parse_args()
    panels = [
        gpu_panel(options.gpu, options.scene, options.calibrated),
        cpu_panel(options.cpu, options.scene, options.cpu_name),
    ]
    options.out.write_text(chart(panels))


if __name__ == "__main__":
    main()
