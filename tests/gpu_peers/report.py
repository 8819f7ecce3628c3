"""The rows as a Markdown table, and the ratio to the best peer."""

# A row whose list is not the exact set is never the best peer.

OURS = "pairmask-"


def our_name(backend, threads):
    """The name of a contender of ours: `pairmask-daemon`, `pairmask-daemon-8-threads`."""
    of_threads = "" if threads == 1 else f"-{threads}-threads"
    return f"{OURS}{backend}{of_threads}"


def our_times(timed):
    """The times of a row of `bench latency --json`, in the columns of all contenders."""

    def ms(stage):
        return round(timed[f"{stage}_ns"]["p50"] / 1e6, 4)

    return {
        "frames": timed["frames"],
        "engine": timed["engine"],
        "decode_threads": timed["decode_threads"],
        "write_ms": ms("fill"),
        "device_ms": ms("round_trip"),
        "engine_ms": ms("engine"),
        "copy_ms": None,
        "iterate_ms": ms("decode"),
        "total_ms": ms("answer"),
        "with_write_ms": ms("total"),
        "error": None,
    }


def contenders(rows):
    """Contenders of the rows, each once, ours first, in their order."""
    names = dict.fromkeys(row["contender"] for row in rows)
    return sorted(names, key=lambda name: not name.startswith(OURS))


def is_exact(row):
    """Whether every checked frame of a row had exactly the exact pairs."""
    return row["error"] is None and all(row[frame]["is_exact"] for frame in ("first", "last"))


def is_ours(row):
    return row["contender"].startswith(OURS)


def settings(rows):
    """Scene and number of boxes of the rows, each once, in their order."""
    return list(dict.fromkeys((row["scene"], row["n"]) for row in rows))


def in_hand_ms(row):
    """Boxes in place → mask, or list, in hand: the frame without the iterating over."""
    return row["device_ms"] if is_ours(row) else round(row["total_ms"] - row["iterate_ms"], 4)


def ratios(rows):
    """For every scene and size, our medians over that of the best peer that lost nothing."""
    found = []
    for scene, n in settings(rows):
        here = [row for row in rows if (row["scene"], row["n"]) == (scene, n)]
        peers = [row for row in here if not is_ours(row) and is_exact(row)]
        best = min(peers, key=lambda row: row["total_ms"], default=None)
        first = min(map(in_hand_ms, peers), default=None)
        for ours in (row for row in here if is_ours(row) and row["error"] is None):
            found.append(
                {
                    "scene": scene,
                    "n": n,
                    "ours": ours["contender"],
                    "ours_ms": ours["total_ms"],
                    "best_peer": best and best["contender"],
                    "best_peer_ms": best and best["total_ms"],
                    "ratio": best and round(ours["total_ms"] / best["total_ms"], 3),
                    "in_hand_ms": in_hand_ms(ours),
                    "best_peer_in_hand_ms": first,
                    "in_hand_ratio": first and round(in_hand_ms(ours) / first, 3),
                }
            )
    return found


def pairs_cell(row):
    """What became of the pairs, of the worse of the two checked frames."""
    if is_ours(row):
        return "exact by its tests"
    checked = max((row["first"], row["last"]), key=lambda c: c["missed"] + c["extra"] + c["repeated"])
    if checked["is_exact"]:
        return f"{checked['expected']:,}: exact"
    if checked["counted"] > checked["capacity"]:
        return f"{checked['counted']:,} counted, room for {checked['capacity']:,}"
    parts = [f"**{checked['missed']:,} of {checked['expected']:,} lost**"] if checked["missed"] else []
    parts += [f"{checked[what]:,} {what}" for what in ("extra", "repeated") if checked[what]]
    return ", ".join(parts) + ", no error"


def number(ms):
    return "–" if ms is None else f"{ms:.3f}"


def table(head, lines):
    """A Markdown table of lists of cells."""
    return ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *lines)]


def ratio_table(found, rows, value, ratio, best):
    """A line for every scene and size: our ratios, our times in brackets, and the best peer's."""
    names = [name for name in contenders(rows) if name.startswith(OURS)]
    lines = []
    for scene, n in settings(rows):
        ours = {row["ours"]: row for row in found if (row["scene"], row["n"]) == (scene, n)}
        cells = [f"{scene}", f"{n:,}"]
        for name in names:
            row = ours.get(name)
            if row is None:
                cells.append("–")
                continue
            share = "–" if row[ratio] is None else f"**{row[ratio]:.2f}**"
            cells.append(f"{share} ({number(row[value])})")
        any_row = next(iter(ours.values()), None)
        cells.append("–" if any_row is None else best(any_row))
        lines.append(cells)
    heads = [name.removeprefix(OURS).replace("-", " ") for name in names]
    return table(["scene", "boxes", *heads, "best peer"], lines)


def totals_table(rows):
    """A line for every scene and size: the total of every contender; a list that lost pairs in brackets."""
    by_setting = {(row["scene"], row["n"], row["contender"]): row for row in rows}
    names = contenders(rows)

    def cell(row):
        if row is None or row["error"] is not None:
            return "–"
        text = number(row["total_ms"])
        return text if is_ours(row) or is_exact(row) else f"({text})"

    lines = [
        [scene, f"{n:,}", *(cell(by_setting.get((scene, n, name))) for name in names)]
        for scene, n in settings(rows)
    ]
    return table(["scene", "boxes", *(name.removeprefix(OURS) for name in names)], lines)


def markdown(report):
    machine, rows = report["machine"], report["rows"]
    lines = [
        "# Whole frames against GPU peers",
        "",
        f"{machine['gpu'] or 'no GPU'}, driver {machine['driver']}; {machine['cpu']}, {machine['cores']} cores; "
        f"{machine['os']}. Pairmask at {machine['commit']}, Warp {machine['warp']}, Newton {machine['newton']}, "
        f"numpy {machine['numpy']}, Python {machine['python']}.",
        "",
        f"`{machine['command']}`",
        "",
        "Medians, ms. Total: boxes in place (shared memory; pinned memory) → every pair iterated over by one thread; "
        "writing the boxes there stands beside it, and in the last total. Of Pairmask, device is the round trip, "
        "and there is no copy: the mask lies where the client reads it. Rows with a number of threads have a "
        "client that iterates over on as many. "
        "Stages of the peers were timed in frames of their own, with a wait after each.",
        "",
        "## Our time over the best peer's",
        "",
        "In brackets our time.",
        "",
        *ratio_table(
            report["ratios"],
            rows,
            "ours_ms",
            "ratio",
            lambda row: f"{row['best_peer'] or '–'} ({number(row['best_peer_ms'])})",
        ),
        "",
        "## The same without iterating over: mask in hand over list in hand",
        "",
        *ratio_table(
            report["ratios"],
            rows,
            "in_hand_ms",
            "in_hand_ratio",
            lambda row: number(row["best_peer_in_hand_ms"]),
        ),
    ]
    lines += [
        "",
        "## Boxes in place → every pair iterated over",
        "",
        "In brackets: pairs were lost, extra or repeated.",
        "",
        *totals_table(rows),
        "",
        "## All rows",
        "",
        "| scene | boxes | | write | device | copy | iterate | total | with write | pairs |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        head = f"| {row['scene']} | {row['n']:,} | {row['contender']} |"
        if row["error"] is not None:
            lines.append(f"{head} – | – | – | – | – | – | {row['error']} |")
            continue
        stages = ("write_ms", "device_ms", "copy_ms", "iterate_ms", "total_ms", "with_write_ms")
        times = " | ".join(number(row[stage]) for stage in stages)
        lines.append(f"{head} {times} | {pairs_cell(row)} |")
    return "\n".join(lines) + "\n"
