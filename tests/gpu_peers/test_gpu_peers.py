"""What needs no GPU: `python3 -m unittest discover tests/gpu_peers`."""

import tempfile
import unittest
from pathlib import Path

import numpy as np

import pair_sets
import report
import scenes

PAIRS = [(0, 1), (2, 5), (3, 4), (4, 9)]


class PairSets(unittest.TestCase):
    def difference(self, found):
        return pair_sets.compare(pair_sets.keys(found), pair_sets.keys(PAIRS))

    def test_order_does_not_matter(self):
        self.assertTrue(self.difference([(9, 4), (0, 1), (3, 4), (5, 2)]).is_exact)

    def test_one_wrong_pair_is_noticed(self):
        difference = self.difference([(0, 1), (2, 5), (3, 4), (4, 8)])
        self.assertEqual((difference.missed, difference.extra, difference.repeated), (1, 1, 0))

    def test_one_lost_and_one_repeated_pair_are_noticed(self):
        difference = self.difference([(0, 1), (0, 1), (3, 4), (4, 9)])
        self.assertEqual((difference.missed, difference.extra, difference.repeated), (1, 0, 1))

    def test_nothing_found_is_everything_missed(self):
        self.assertEqual(self.difference(np.empty((0, 2))).missed, len(PAIRS))


class Motion(unittest.TestCase):
    def test_the_stream_is_that_of_the_daemon(self):
        # The numbers of daemon/src/scene/random.rs.
        self.assertEqual([hex(x) for x in scenes.bits(0, 2)], ["0xe220a8397b1dcdaf", "0x6e789e6aa1b965f4"])

    def test_boxes_move_two_percent_and_keep_their_size(self):
        random = np.random.default_rng(1)
        lower = random.uniform(0, 9, (500, 3)).astype(np.float32)
        scene = scenes.Scene(lower, lower + np.float32(1))
        scene.step()
        moved = np.linalg.norm(scene.lower - lower, axis=1)
        np.testing.assert_allclose(moved, 0.02, rtol=1e-3)
        for _ in range(200):
            scene.step()
        np.testing.assert_allclose(scene.upper - scene.lower, 1, rtol=1e-4)
        self.assertTrue((scene.lower > -0.6).all() and (scene.upper < 10.6).all())

    def test_a_file_keeps_its_boxes(self):
        lower = np.arange(12, dtype=np.float32).reshape(4, 3)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "boxes.f32"
            scenes.write(path, lower, lower + 1)
            for found, written in zip(scenes.read(path), (lower, lower + 1), strict=True):
                np.testing.assert_array_equal(found, written)


def checked(missed):
    return {
        "expected": 10,
        "counted": 10 - missed,
        "capacity": 100,
        "missed": missed,
        "extra": 0,
        "repeated": 0,
        "is_exact": missed == 0,
    }


def row(contender, total_ms, missed=0):
    setting = {"contender": contender, "scene": "uniform", "n": 1000, "error": None}
    times = dict.fromkeys(("write_ms", "device_ms", "copy_ms", "iterate_ms", "with_write_ms"), 0.5)
    return setting | times | {"total_ms": total_ms, "first": checked(0), "last": checked(missed)}


class Report(unittest.TestCase):
    ROWS = (row("pairmask-daemon", 2.0), row("warp-refit", 4.0), row("newton-sap", 1.0, missed=3))

    def test_a_peer_that_lost_a_pair_is_not_the_best(self):
        (found,) = report.ratios(self.ROWS)
        self.assertEqual((found["best_peer"], found["ratio"]), ("warp-refit", 0.5))
        # The mask after 0.5, the list after 4 less the 0.5 of its iterate over.
        self.assertEqual((found["in_hand_ms"], found["best_peer_in_hand_ms"]), (0.5, 3.5))

    def test_lost_pairs_are_reported(self):
        machine = dict.fromkeys(
            ("gpu", "driver", "cpu", "cores", "os", "commit", "warp", "newton", "numpy", "python", "command")
        )
        rows = list(self.ROWS)
        text = report.markdown({"machine": machine, "rows": rows, "ratios": report.ratios(rows)})
        self.assertIn("**3 of 10 lost**, no error", text)
        self.assertIn("| scene | boxes | daemon | best peer |", text)
        self.assertIn("| uniform | 1,000 | **0.50** (2.000) | warp-refit (4.000) |", text)
        self.assertIn("| scene | boxes | daemon | warp-refit | newton-sap |", text)
        self.assertIn("| uniform | 1,000 | 2.000 | 4.000 | (1.000) |", text)

    def test_our_total_is_the_answer_and_not_the_writing(self):
        stages = {"fill": 5e5, "round_trip": 1e6, "engine": 9e5, "decode": 2e6, "answer": 3.1e6, "total": 3.7e6}
        timed = {f"{stage}_ns": {"p50": int(ns)} for stage, ns in stages.items()}
        times = report.our_times(timed | {"frames": 40, "engine": "gpu-grid", "decode_threads": 8})
        self.assertEqual((times["total_ms"], times["with_write_ms"], times["write_ms"]), (3.1, 3.7, 0.5))
        self.assertEqual((times["device_ms"], times["iterate_ms"], times["copy_ms"]), (1.0, 2.0, None))

    def test_rows_of_ours_are_named_by_backend_and_threads(self):
        self.assertEqual(report.our_name("daemon", 1), "pairmask-daemon")
        self.assertEqual(report.our_name("in-process", 8), "pairmask-in-process-8-threads")
        names = report.contenders([row("warp-refit", 1.0), row("pairmask-daemon", 1.0)])
        self.assertEqual(names, ["pairmask-daemon", "warp-refit"])


if __name__ == "__main__":
    unittest.main()
