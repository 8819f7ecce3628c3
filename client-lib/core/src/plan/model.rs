//! The cost model: what every engine that is to be had would take for a frame.

use super::{Calibration, Candidate, Capabilities, CullOptions, GpuCost, SceneStats, Work};
use crate::engine::{EngineDescriptor, EngineName, EnginePlace};
use crate::mask::{Encoding, EncodingChoice};

/// Counting and placing sparse words, or pairs of a list, takes a GPU so much longer than packing a
/// small dense mask: 14.5 µs against 8.6 for both its stages at 1,000 boxes on an H200.
const GPU_COUNTED_STAGE_NS: f64 = 5_500.0;

/// The cost model of one frame.
pub(super) struct Model<'a> {
    pub stats: &'a SceneStats,
    pub capabilities: &'a Capabilities,
    pub calibration: &'a Calibration,
    pub options: &'a CullOptions,
}

impl Model<'_> {
    /// The cheapest way to run an engine, if it is to be had.
    pub fn candidate(&self, engine: EngineName) -> Option<Candidate> {
        // Of ways that take the same time the first is taken: sparse before dense.
        let ways = Encoding::ALL.into_iter().rev().filter(|encoding| {
            let is_wanted = match self.options.encoding {
                EncodingChoice::Auto => self.options.readable.contains(*encoding),
                EncodingChoice::Only(wanted) => wanted == *encoding,
            };
            is_wanted && engine.descriptor().encodings.contains(encoding)
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
        let EngineDescriptor { place: EnginePlace::Gpu(own), has_order, .. } = engine.descriptor()
        else {
            return None;
        };
        let gpu: &GpuCost = self.capabilities.gpu.as_ref()?;
        let n = f64::from(self.stats.n.get());
        let execute_ns = (own.execute_ns)(gpu, self.stats)?;
        let pairs = self.stats.expected_pairs();
        // A list has names instead of words with addresses and an order.
        let reply_bytes = match encoding {
            Encoding::List => 8.0 * pairs,
            _ => 4.0 * n + 12.0 * pairs,
        };
        let stage_ns = if encoding == Encoding::Dense { 0.0 } else { GPU_COUNTED_STAGE_NS };
        let mask = Work::of_mask(encoding, self.stats, *has_order);
        let boxes_ns = gpu.fixed_ns + gpu.ns_a_box * n;
        let reply_ns = gpu.ns_a_reply_byte * reply_bytes + stage_ns;
        Some(boxes_ns + execute_ns + reply_ns + self.calibration.time_ns(&mask))
    }
}
