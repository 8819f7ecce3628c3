"""Timed frames of one peer: boxes in pinned memory → every pair iterated over by one thread."""

import sys
import time
from dataclasses import dataclass, field

import numpy as np
import warp as wp

# Room for pairs, a box: the densest scene has 7, and boxes that drift bring more.
PAIRS_PER_BOX = 12
# Pairs that are copied without knowing how many there are, over those of the frames before.
COPY_SHARE = 1.25


@dataclass
class Times:
    """Seconds of each frame, by stage."""

    write: list = field(default_factory=list)
    device: list = field(default_factory=list)
    copy: list = field(default_factory=list)
    iterate: list = field(default_factory=list)
    total: list = field(default_factory=list)
    with_write: list = field(default_factory=list)


class Frames:
    """One peer over one scene.

    The whole frame is recorded as one CUDA graph where the peer allows it: boxes up, pairs found,
    the counter and as many pairs as are expected down. What is beyond that is copied afterwards.
    """

    def __init__(self, contender, n, device, lower, upper):
        self.contender, self.device = contender, wp.get_device(device)
        self.is_cuda = self.device.is_cuda
        capacity = max(PAIRS_PER_BOX * n, 4096)

        def host(shape, dtype):
            return wp.empty(shape, dtype=dtype, device="cpu", pinned=self.is_cuda)

        self.host_lower, self.host_upper = host(n, wp.vec3), host(n, wp.vec3)
        self.host_pairs, self.host_count = host(capacity, wp.vec2i), host(1, wp.int32)
        self.np_lower, self.np_upper = self.host_lower.numpy(), self.host_upper.numpy()
        self.np_pairs, self.np_count = self.host_pairs.numpy(), self.host_count.numpy()
        # One number a pair, so that summing them is one pass at the speed of memory.
        self.np_iterated = self.np_pairs.reshape(-1).view(np.int64)
        self.lower = wp.empty(n, dtype=wp.vec3, device=self.device)
        self.upper = wp.empty(n, dtype=wp.vec3, device=self.device)
        self.pairs = wp.empty(capacity, dtype=wp.vec2i, device=self.device)
        self.count = wp.zeros(1, dtype=wp.int32, device=self.device)
        self.capacity, self.expected = capacity, 0
        self._write(lower, upper)
        self._upload()
        contender.prepare(self.lower, self.upper, self.pairs, self.count)
        for _ in range(2):
            self._device_part()
            wp.synchronize_device(self.device)
        self.expected = min(int(self._found() * COPY_SHARE) + 1024, capacity)
        self.whole = self.device_only = self.copy_only = None
        if self.is_cuda and contender.can_be_recorded:
            try:
                self.device_only = self._record(self._device_part)
                self.copy_only = self._record(self._copy_part)
                self.whole = self._record(lambda: (self._device_part(), self._copy_part()))
            except RuntimeError as error:
                # What cannot be recorded is submitted call by call; the row says so.
                print(f"{contender.library}: not recorded: {error}", file=sys.stderr)
                self.whole = self.device_only = self.copy_only = None
                wp.synchronize_device(self.device)

    @property
    def is_recorded(self):
        return self.whole is not None

    def _record(self, work):
        with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
            work()
        return capture.graph

    def _write(self, lower, upper):
        np.copyto(self.np_lower, lower)
        np.copyto(self.np_upper, upper)

    def _upload(self):
        wp.copy(self.lower, self.host_lower)
        wp.copy(self.upper, self.host_upper)

    def _device_part(self):
        self._upload()
        self.contender.find()
        wp.copy(self.host_count, self.count)

    def _copy_part(self):
        wp.copy(self.host_pairs, self.pairs, count=self.expected)

    def _found(self):
        return min(int(self.np_count[0]), self.capacity)

    def _copy_rest(self):
        found = self._found()
        if found > self.expected:
            rest = found - self.expected
            wp.copy(self.host_pairs, self.pairs, self.expected, self.expected, count=rest)
            self._wait()

    def _wait(self):
        if self.is_cuda:
            wp.synchronize_stream(self.device.stream)

    def _submit(self, graph, work):
        if graph is None:
            work()
        else:
            wp.capture_launch(graph)
        self._wait()

    def _iterate(self):
        return int(self.np_iterated[: self._found()].sum())

    def whole_frame(self, lower, upper, times=None):
        """A frame with one wait in it."""
        start = time.perf_counter()
        self._write(lower, upper)
        written = time.perf_counter()
        self._submit(self.whole, lambda: (self._device_part(), self._copy_part()))
        self._copy_rest()
        self._iterate()
        end = time.perf_counter()
        if times is not None:
            times.total.append(end - written)
            times.with_write.append(end - start)

    def split_frame(self, lower, upper, times):
        """The same with a wait after each stage: the stages' times, a little longer in sum."""
        clock = [time.perf_counter()]
        self._write(lower, upper)
        clock.append(time.perf_counter())
        self._submit(self.device_only, self._device_part)
        clock.append(time.perf_counter())
        self._submit(self.copy_only, self._copy_part)
        self._copy_rest()
        clock.append(time.perf_counter())
        self._iterate()
        clock.append(time.perf_counter())
        for stage, since, until in zip(
            (times.write, times.device, times.copy, times.iterate), clock[:-1], clock[1:], strict=True
        ):
            stage.append(until - since)

    def found_pairs(self):
        """The pairs of the last frame, shape (count, 2), and what the counter says."""
        return self.np_pairs[: self._found()].copy(), int(self.np_count[0])
