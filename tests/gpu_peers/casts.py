"""Rays (the closest box of each) by Warp's BVH, end to end: rays from host memory, hits back in it.

    python tests/gpu_peers/casts.py uniform.raw uniform-2.raw pile.raw pile-2.raw

Boxes of two files a scene, as `pairmaskd scene` writes them: those that are hit, and those of another seed, at whose min
corners rays begin, as in `--bench casts`. A row a scene: the median, least and most ms of a batch,
as `--bench casts` prints them for the other contenders. The tree is built before, and refitted in rows that say so.
"""

import sys
import time

import numpy as np
import warp as wp

RAYS = 10_000
ROUNDS = 31
WARM_UP = 5


@wp.kernel(enable_backward=False)
def _closest(
    bvh: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    index: wp.array(dtype=int),
    distance: wp.array(dtype=float),
):
    i = wp.tid()
    origin = origins[i]
    direction = directions[i]
    over = wp.vec3(1.0 / direction[0], 1.0 / direction[1], 1.0 / direction[2])
    query = wp.bvh_query_ray(bvh, origin, direction)
    best = float(1.0e30)
    found = int(-1)
    j = int(0)
    while wp.bvh_query_next(query, j, best):
        a = wp.cw_mul(lower[j] - origin, over)
        b = wp.cw_mul(upper[j] - origin, over)
        enter = wp.max(wp.max(wp.min(a, b)), 0.0)
        leave = wp.min(wp.max(a, b))
        if enter <= leave and enter < best:
            best = enter
            found = j
    index[i] = found
    distance[i] = best


def _measure(file, others):
    boxes, others = (np.fromfile(name, dtype=np.float32).reshape(-1, 6) for name in (file, others))
    rng = np.random.default_rng(3)
    origins = np.ascontiguousarray(others[:: max(1, len(others) // RAYS), :3][:RAYS])
    directions = rng.uniform(-1, 1, (RAYS, 3)).astype(np.float32)
    lower, upper = (wp.array(np.ascontiguousarray(part), dtype=wp.vec3) for part in (boxes[:, :3], boxes[:, 3:]))

    def pinned(values, dtype):
        return wp.array(values, dtype=dtype, device="cpu", pinned=True)

    host = [pinned(origins, wp.vec3), pinned(directions, wp.vec3)]
    hits = [pinned(np.zeros(RAYS, np.int32), int), pinned(np.zeros(RAYS, np.float32), float)]
    rays = [wp.zeros_like(array, device="cuda") for array in host]
    found = [wp.zeros_like(array, device="cuda") for array in hits]
    for constructor in ("sah", "lbvh", "cubql"):
        try:
            bvh = wp.Bvh(lower, upper, constructor=constructor)
        except Exception as error:  # not every version has every builder
            print(f"{file} {constructor}: {error}")
            continue
        for refits in (False, True):
            times = []
            for turn in range(WARM_UP + ROUNDS):
                wp.synchronize()
                begin = time.perf_counter()
                if refits:
                    bvh.refit()
                for here, there in zip(host, rays):
                    wp.copy(there, here)
                wp.launch(_closest, dim=RAYS, inputs=[bvh.id, lower, upper, *rays, *found])
                for here, there in zip(hits, found):
                    wp.copy(here, there)
                wp.synchronize()
                total = float(hits[1].numpy().sum())
                if turn >= WARM_UP:
                    times.append(1e3 * (time.perf_counter() - begin))
            count = int((hits[0].numpy() >= 0).sum())
            print(
                f"rays {file} warp-{constructor}{'-refit' if refits else ''}: "
                f"{np.median(times):.3f} [{min(times):.3f} {max(times):.3f}] ms, {count} hits, {total:.3e}"
            )


if __name__ == "__main__":
    wp.init()
    for file, others in zip(sys.argv[1::2], sys.argv[2::2]):
        _measure(file, others)
