// Sums over the lanes of a workgroup.

var<workgroup> scan: array<u32, BATCH_BOXES>;

// Each lane's number becomes the sum of those of all lanes up to this one. All lanes call it, after
// a barrier that follows their writes to `scan`; the sums are there for all when it returns.
fn sum_up(lane: u32) {
    for (var reach = 1u; reach < BATCH_BOXES; reach <<= 1u) {
        var before = 0u;
        if (lane >= reach) {
            before = scan[lane - reach];
        }
        workgroupBarrier();
        scan[lane] += before;
        workgroupBarrier();
    }
}
