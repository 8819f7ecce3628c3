//! One way to cull a frame, with its engine kept warm, timed frame by frame.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use crate::Result;
use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::engine::{
    AvailableIsa, CullError, CullInput, Engine, EngineName, HeapReply, cpu_engine,
};
use pairmask_core::{Aabb, BoxCount, Encoding, MaskView};
use rayon::ThreadPool;

/// An engine, an encoding and a number of threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Way {
    pub engine: EngineName,
    pub encoding: Encoding,
    pub threads: usize,
}

/// Times of a way's frames, ns, and its last mask.
#[derive(Clone, Debug, Default)]
pub struct WayTimes {
    /// From the boxes in memory to the mask, every frame.
    pub engine_ns: Vec<u64>,
    /// From the mask to the last pair on one thread, every frame.
    pub decode_ns: Vec<u64>,
    pub pair_count: u64,
}

impl WayTimes {
    /// The shortest frame, engine and decode, ns.
    pub fn least_ns(&self) -> u64 {
        let frames = self.engine_ns.iter().zip(&self.decode_ns);
        frames.map(|(engine, decode)| engine + decode).min().unwrap_or(0)
    }
}

/// A way with its engine and its memory.
pub struct TimedWay {
    pub way: Way,
    pub times: WayTimes,
    engine: Box<dyn Engine>,
    isa: AvailableIsa,
    reply: HeapReply,
    /// Where the engine runs; `None` is the calling thread.
    pool: Option<Arc<ThreadPool>>,
}

impl TimedWay {
    /// A way with a new engine, `None` for a GPU engine. More than one thread needs a pool.
    pub fn new(way: Way, pool: Option<Arc<ThreadPool>>, isa: AvailableIsa) -> Option<Self> {
        let engine = cpu_engine(way.engine, isa.get()).ok()?;
        let (times, reply) = (WayTimes::default(), HeapReply::new());
        Some(Self { way, times, engine, isa, reply, pool })
    }

    /// Culls and decodes one frame, and stores its times if `is_noted`.
    pub fn frame(&mut self, boxes: &[Aabb], is_noted: bool) -> Result<()> {
        let (engine, reply) = (&mut self.engine, &mut self.reply);
        let mut cull = || -> Result<_, CullError> {
            let start = Instant::now();
            let report = engine.cull(
                &CullInput::boxes(boxes).encoding(self.way.encoding).threads(self.way.threads),
                reply,
            )?;
            Ok((report, nanoseconds_since(start)))
        };
        let (report, engine_ns) = match &self.pool {
            Some(pool) => pool.install(cull),
            None => cull(),
        }?;
        let n = BoxCount::new(boxes.len() as u32);
        let start = Instant::now();
        let mask = MaskView::new(n, &report.shape, self.reply.words())?.with_isa(self.isa);
        let (mut decoded, mut indices) = (0u64, 0);
        mask.for_each(|a, b| {
            decoded += 1;
            indices ^= a ^ b;
        });
        black_box(indices);
        let decode_ns = nanoseconds_since(start);
        if decoded != report.pair_count {
            let (engine, counted) = (self.way.engine, report.pair_count);
            return Err(format!(
                "{engine} counted {counted} pairs and its mask holds {decoded}: please report this"
            )
            .into());
        }
        self.times.pair_count = decoded;
        if is_noted {
            self.times.engine_ns.push(engine_ns);
            self.times.decode_ns.push(decode_ns);
        }
        Ok(())
    }
}
