"""Draws what `bench` has printed, or a record of it: time of a step's broad phase by bodies, on logarithmic scales.

    python3 examples/bullet/chart.py tests/records/2026-11-23-h200/bullet.txt > tests/records/2026-11-23-h200/bullet.svg

Of a record with several tables the first is drawn.
"""

import math
import sys

WIDTH, HEIGHT, MARGIN = 360, 260, 56
COLORS = {"pairmask": "#0b6e4f", "btDbvt": "#c1440e", "btAxisSweep3": "#555b9e", "none": "#999999"}
BODIES = [1000, 4000, 16000, 64000]
MILLISECONDS = [0.01, 0.1, 1, 10, 100, 1000]


def tables(lines):
    """Rows of the first table: (scene, broad phase) to [(bodies, ms)]."""
    rows = {}
    for line in lines:
        words = line.split()
        if words[:2] == ["scene", "bodies"] and rows:
            break
        if len(words) == 6 and words[1].isdigit():
            rows.setdefault((words[0], words[2]), []).append((int(words[1]), float(words[4])))
    return rows


def scaled(value, values, start, length):
    low, high = math.log(values[0]), math.log(values[-1])
    return start + length * (math.log(value) - low) / (high - low)


def panel(scene, rows, left):
    x = lambda bodies: left + scaled(bodies, BODIES, MARGIN, WIDTH - MARGIN - 28)
    y = lambda ms: HEIGHT - scaled(ms, MILLISECONDS, MARGIN, HEIGHT - MARGIN - 40)
    yield f'<text x="{left + WIDTH / 2}" y="20" text-anchor="middle" font-weight="bold">{scene}</text>'
    for ms in MILLISECONDS:
        yield f'<line x1="{x(BODIES[0])}" x2="{x(BODIES[-1])}" y1="{y(ms):.1f}" y2="{y(ms):.1f}" stroke="#ddd"/>'
        yield f'<text x="{x(BODIES[0]) - 6}" y="{y(ms) + 4:.1f}" text-anchor="end">{ms:g} ms</text>'
    for bodies in BODIES:
        yield f'<text x="{x(bodies):.1f}" y="{HEIGHT - MARGIN + 16}" text-anchor="middle">{bodies:,}</text>'
    for (of, name), points in rows.items():
        if of == scene:
            path = " ".join(f"{x(bodies):.1f},{y(ms):.1f}" for bodies, ms in points)
            yield f'<polyline points="{path}" fill="none" stroke="{COLORS[name]}" stroke-width="2"/>'


def main():
    rows = tables(open(sys.argv[1]))
    scenes = list(dict.fromkeys(scene for scene, _ in rows))
    assert scenes, "no table of the bench"
    width = WIDTH * len(scenes)
    print(f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{HEIGHT + 8}" font-family="sans-serif" font-size="11">')
    print(f'<rect width="{width}" height="{HEIGHT + 8}" fill="white"/>')
    for box_at, scene in enumerate(scenes):
        print("\n".join(panel(scene, rows, box_at * WIDTH)))
    for box_at, (name, color) in enumerate(COLORS.items()):
        at = MARGIN + 150 * box_at
        print(f'<line x1="{at}" x2="{at + 20}" y1="{HEIGHT - 6}" y2="{HEIGHT - 6}" stroke="{color}" stroke-width="2"/>')
        print(f'<text x="{at + 26}" y="{HEIGHT - 2}">{name}</text>')
    print("</svg>")


main()
