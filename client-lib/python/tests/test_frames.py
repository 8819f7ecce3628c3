"""Frames: numpy in, numpy out."""

import numpy as np
import pairmask


def test_boxes_in_pairs_out():
    boxes = np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 2, 1, 1], [5, 5, 5, 6, 6, 6]], np.float32)
    with pairmask.Session("in-process") as session:
        frame = session.frame(3)
        frame.boxes[:] = boxes
        mask = frame.submit().wait()
        assert mask.pairs().tolist() == [[0, 1]]
        assert session.cull(boxes).tolist() == [[0, 1]]
