//! The cost model: what every engine that is available would take for a frame.

use super::{Calibration, Candidate, Capabilities, CullOptions, GpuCost, SceneStats};
use crate::engine::{EngineName, EngineSide, encoding_cost};
use crate::mask::{Encoding, EncodingChoice};
use crate::team;

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
    /// The cheapest way to run an engine, if it is available.
    pub fn candidate(&self, engine: EngineName) -> Option<Candidate> {
        // Of ways that take the same time the first is taken: sparse before dense.
        let ways = Encoding::ALL.into_iter().rev().filter(|encoding| {
            let is_requested = match self.options.encoding {
                EncodingChoice::Auto => !(self.options.no_dense && *encoding == Encoding::Dense),
                EncodingChoice::Only(requested) => requested == *encoding,
            };
            is_requested && engine.descriptor().encodings.contains(encoding)
        });
        let ways = ways.filter_map(|encoding| self.way(engine, encoding));
        ways.min_by(|a, b| a.predicted_ns.total_cmp(&b.predicted_ns))
    }

    fn way(&self, engine: EngineName, encoding: Encoding) -> Option<Candidate> {
        let (cull_ns, threads) = match self.calibration.cull_ns(engine, encoding, self.stats) {
            Some(one_ns) => self.on_threads(one_ns),
            None => (self.gpu_ns(engine, encoding)?, 1),
        };
        let iterate_ns = self.iterate_ns(engine, encoding);
        Some(Candidate {
            engine,
            encoding,
            threads,
            predicted_ns: cull_ns + iterate_ns,
            iterate_ns,
        })
    }

    fn on_threads(&self, one_ns: f64) -> (f64, usize) {
        let threads = team::threads_worth(one_ns, self.capabilities.threads);
        (team::time_ns(one_ns, threads), threads)
    }

    /// The client's part. Its further threads are of use where there is enough to iterate over.
    fn iterate_ns(&self, engine: EngineName, encoding: Encoding) -> f64 {
        let iterate_ns = self.calibration.iterate_ns(engine, encoding, self.stats);
        let far_ns = match self.capabilities.gpu {
            Some(gpu) if engine.is_gpu() => gpu.ns_a_read_byte * self.mask_bytes(engine, encoding),
            _ => 0.0,
        };
        let one_ns = iterate_ns + far_ns;
        match self.options.iterate_threads {
            Some(threads) if threads > 1 => team::time_ns(one_ns, threads).min(one_ns),
            _ => one_ns,
        }
    }

    fn mask_bytes(&self, engine: EngineName, encoding: Encoding) -> f64 {
        (encoding_cost(encoding).bytes)(self.stats, engine.descriptor().has_order)
    }

    fn gpu_ns(&self, engine: EngineName, encoding: Encoding) -> Option<f64> {
        let EngineSide::Gpu(own) = engine.descriptor().slot else { return None };
        let gpu: &GpuCost = self.capabilities.gpu.as_ref()?;
        let execute_ns = (own.execute_ns)(gpu, self.stats)?;
        let stage_ns = if encoding == Encoding::Dense { 0.0 } else { GPU_COUNTED_STAGE_NS };
        let boxes_ns = gpu.fixed_ns + gpu.ns_a_box * f64::from(self.stats.n.get());
        let reply_ns = gpu.ns_a_reply_byte * self.mask_bytes(engine, encoding) + stage_ns;
        Some(boxes_ns + execute_ns + reply_ns)
    }
}
