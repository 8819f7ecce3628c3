"""The peers: each finds the pairs of boxes in device arrays and appends them to a list.

A list is an array of pairs and a counter. The counter counts every pair; a pair for which the
array has no room is not written, so that a counter above the capacity shows lost pairs.
"""

import warp as wp


@wp.kernel(enable_backward=False)
def _query_all(
    bvh: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    pairs: wp.array(dtype=wp.vec2i),
    count: wp.array(dtype=int),
):
    i = wp.tid()
    query = wp.bvh_query_aabb(bvh, lower[i], upper[i])
    j = int(0)
    while wp.bvh_query_next(query, j):
        if i < j:
            slot = wp.atomic_add(count, 0, 1)
            if slot < pairs.shape[0]:
                pairs[slot] = wp.vec2i(i, j)


class WarpBvh:
    """A `wp.Bvh`, refitted or built anew each frame, then one query a box."""

    library = "warp"

    def __init__(self, constructor, is_rebuilt):
        self.constructor, self.is_rebuilt = constructor, is_rebuilt
        # Warp promises that its own builder may be recorded in a graph, and not so of cuBQL's.
        self.can_be_recorded = not (is_rebuilt and constructor == "cubql")

    def prepare(self, lower, upper, pairs, count):
        constructor = self.constructor if lower.device.is_cuda else None
        self.lower, self.upper, self.pairs, self.count = lower, upper, pairs, count
        self.bvh = wp.Bvh(lower, upper, constructor=constructor)

    def find(self):
        if self.is_rebuilt:
            self.bvh.rebuild()
        else:
            self.bvh.refit()
        self.count.zero_()
        wp.launch(
            _query_all,
            dim=len(self.lower),
            inputs=[self.bvh.id, self.lower, self.upper, self.pairs, self.count],
            device=self.lower.device,
        )


class Newton:
    """A broad phase of Newton, all shapes in one world and one group, no gaps."""

    library = "newton"
    can_be_recorded = True

    def __init__(self, phase, most_boxes):
        self.phase, self.most_boxes = phase, most_boxes

    def prepare(self, lower, upper, pairs, count):
        from newton import geometry

        n, device = len(lower), lower.device
        # World -1 holds what every world shares: one segment, the shortest way through the code.
        self.world = wp.full(n, -1, dtype=wp.int32, device=device)
        self.group = wp.full(n, 1, dtype=wp.int32, device=device)
        self.broad_phase = getattr(geometry, self.phase)(self.world, device=device)
        self.arguments = (lower, upper, None, self.group, self.world, n, pairs, count, device)

    def find(self):
        self.broad_phase.launch(*self.arguments)


def all_contenders():
    """Every peer by name. A number of boxes beyond which it is not run stands with it."""
    return {
        "warp-refit": WarpBvh("lbvh", is_rebuilt=False),
        "warp-rebuild": WarpBvh("lbvh", is_rebuilt=True),
        "warp-cubql-refit": WarpBvh("cubql", is_rebuilt=False),
        "warp-cubql-rebuild": WarpBvh("cubql", is_rebuilt=True),
        # All pairs of a million boxes are 5·10^11 tests.
        "newton-all-pairs": Newton("BroadPhaseAllPairs", most_boxes=100_000),
        "newton-sap": Newton("BroadPhaseSAP", most_boxes=None),
    }
