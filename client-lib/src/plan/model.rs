//! The cost model: what every engine that is to be had would take for a frame.

use super::{Calibration, Candidate, Capabilities, CullWish, GpuCost, SceneStats, Work};
use crate::engine::EngineName;
use crate::mask::{Encoding, EncodingChoice};

/// Counting and placing sparse words takes a GPU so much longer than packing a small dense mask:
/// 14.5 µs against 8.6 for both its stages at 1,000 boxes on an H200.
const GPU_SPARSE_STAGE_NS: f64 = 5_500.0;

/// The cost model of one frame.
pub(super) struct Model<'a> {
    pub stats: &'a SceneStats,
    pub capabilities: &'a Capabilities,
    pub calibration: &'a Calibration,
    pub wish: &'a CullWish,
}

impl Model<'_> {
    /// The cheapest way to run an engine, if it is to be had.
    pub fn candidate(&self, engine: EngineName) -> Option<Candidate> {
        let ways = [Encoding::Sparse, Encoding::Dense].into_iter().filter(|encoding| {
            let is_wanted = match self.wish.encoding {
                EncodingChoice::Auto => self.wish.readable.contains(*encoding),
                EncodingChoice::Only(wanted) => wanted == *encoding,
            };
            // The GPU's grid writes sparse masks only.
            is_wanted && (engine, *encoding) != (EngineName::GpuGrid, Encoding::Dense)
        });
        let ways = ways.filter_map(|encoding| self.way(engine, encoding));
        ways.min_by(|a, b| a.predicted_ns.total_cmp(&b.predicted_ns))
    }

    fn way(&self, engine: EngineName, encoding: Encoding) -> Option<Candidate> {
        let (predicted_ns, threads) = match Work::of(engine, encoding, self.stats) {
            Some(work) => self.on_threads(engine, self.calibration.time_ns(&work)),
            None => (self.gpu_ns(engine, encoding)?, 1),
        };
        Some(Candidate { engine, encoding, threads, predicted_ns })
    }

    /// One thread or all of them.
    fn on_threads(&self, engine: EngineName, one_ns: f64) -> (f64, usize) {
        let threads = self.capabilities.threads.max(1);
        let all_ns = self.calibration.threads_of(engine).on(threads, one_ns);
        if threads > 1 && all_ns < one_ns { (all_ns, threads) } else { (one_ns, 1) }
    }

    fn gpu_ns(&self, engine: EngineName, encoding: Encoding) -> Option<f64> {
        let gpu: &GpuCost = self.capabilities.gpu.as_ref()?;
        let n = f64::from(self.stats.n.get());
        let execute_ns = match engine {
            EngineName::GpuBrute => gpu.ns_a_test * self.stats.n.pair_count() as f64,
            EngineName::GpuGrid => gpu.grid_fixed_ns + gpu.grid_ns_a_box? * n,
            EngineName::CpuBrute | EngineName::CpuSap | EngineName::CpuGrid => return None,
        };
        let reply_bytes = 4.0 * n + 12.0 * self.stats.expected_pairs();
        let stage_ns = match encoding {
            Encoding::Dense => 0.0,
            Encoding::Sparse => GPU_SPARSE_STAGE_NS,
        };
        let is_ordered = engine == EngineName::GpuGrid;
        let mask = Work::of_mask(encoding, self.stats, is_ordered);
        let boxes_ns = gpu.fixed_ns + gpu.ns_a_box * n;
        let reply_ns = gpu.ns_a_reply_byte * reply_bytes + stage_ns;
        Some(boxes_ns + execute_ns + reply_ns + self.calibration.time_ns(&mask))
    }
}
