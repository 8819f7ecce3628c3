//! Many spheres: a box engine finds the candidates among the spheres' bounds, and each is tested.

use std::ops::Range;
use std::time::Instant;

use super::Sphere;
use super::all_pairs::{counted, zero_words};
use super::bounds::bounds;
use super::exact::Ball;
use crate::aabb::Aabb;
use crate::engine::strips::{WordSink, in_parts, part_count, publish};
use crate::engine::{
    CpuEngines, CullAnswer, CullError, CullReport, CullWish, HeapReply, ReplyBuffer, SkipMeter,
    nanoseconds_since,
};
use crate::floats;
use crate::mask::{Encoding, EncodingChoice, MaskShape, Span};

/// Fewest words of a task: below, handing it to another thread costs more than it saves.
const TASK_WORDS: usize = 2_048;

/// Spheres through the box engines: exact, in O(n + pairs) where those are.
///
/// The bounds are rounded outward ([`Sphere::bounds`]), so the boxes' pairs hold all of the
/// spheres'; the exact test of a pair takes the rest out.
#[derive(Default)]
pub struct SphereFilter {
    boxes: Vec<Aabb>,
    balls: Vec<Ball>,
    identity: Vec<u32>,
    candidates: HeapReply,
    tasks: Vec<Task>,
}

/// Words of one thread's turn.
#[derive(Default)]
struct Task {
    words: Range<usize>,
    found: WordSink,
}

/// The sparse mask of the boxes, where it lies.
#[derive(Clone, Copy)]
struct Candidates<'a> {
    rows: &'a [u32],
    blocks: &'a [u32],
    bits: &'a [u32],
    order: &'a [u32],
}

impl SphereFilter {
    /// A filter with empty scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Writes the pair mask of `spheres` into memory of `reply`; `engines` find the candidates.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    pub fn cull(
        &mut self,
        engines: &mut CpuEngines,
        spheres: &[Sphere],
        wish: &CullWish,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let n = counted(spheres)?;
        let start = Instant::now();
        self.ingest(spheres);
        let bounds_ns = nanoseconds_since(start);
        let sparse = CullWish { encoding: EncodingChoice::Only(Encoding::Sparse), ..*wish };
        let answer = engines.cull(&self.boxes, &sparse, &mut self.candidates)?;
        let found_at = Instant::now();

        let words = self.candidates.words();
        let candidates = Candidates::of(&answer.report.shape, words, &mut self.identity, n.get());
        let parts = part_count(candidates.bits.len(), TASK_WORDS, answer.threads);
        if self.tasks.len() < parts {
            // Never fewer: the number of words, and of parts, changes from frame to frame.
            self.tasks.resize_with(parts, Task::default);
        }
        let (tasks, idle) = self.tasks.split_at_mut(parts);
        // What has nothing to do for two frames gives its memory back.
        for task in idle {
            task.found.clear();
        }
        for (part, task) in tasks.iter_mut().enumerate() {
            let border = |part: usize| candidates.bits.len() * part / parts;
            task.words = border(part)..border(part + 1);
        }
        let balls = self.balls.as_slice();
        let run = |tasks: &mut [Task]| tasks.iter_mut().for_each(|t| t.run(&candidates, balls));
        in_parts(&mut *tasks, parts, &run, &|(), ()| ());
        let filtered_at = Instant::now();

        let sinks = tasks.iter().map(|task| &task.found);
        let shape = publish(sinks, candidates.order, encoding, parts > 1, reply)?;
        let zero_words = zero_words(n, &shape);
        let mut times = answer.times;
        times.ingest_ns += bounds_ns;
        times.execute_ns += times.publish_ns + (filtered_at - found_at).as_nanos() as u64;
        times.publish_ns = nanoseconds_since(filtered_at);
        times.total_ns = nanoseconds_since(start);
        let report = CullReport {
            shape,
            census: answer.report.census,
            pair_count: tasks.iter().map(|task| task.found.pair_count()).sum(),
            skipped: SkipMeter { zero_words, ..answer.report.skipped },
            times: crate::engine::EngineTimes {
                ingest_ns: times.ingest_ns,
                execute_ns: times.execute_ns,
                publish_ns: times.publish_ns,
            },
        };
        Ok(CullAnswer { report, times, ..answer })
    }

    fn ingest(&mut self, spheres: &[Sphere]) {
        self.boxes.clear();
        self.balls.clear();
        floats::with_default(|| {
            for sphere in spheres {
                // Copied once: a client could write to it meanwhile.
                let sphere = *sphere;
                self.boxes.push(bounds(&sphere));
                self.balls.push(Ball::of(&sphere));
            }
        });
    }
}

impl<'a> Candidates<'a> {
    /// The mask that an engine just wrote. Without an order of its own it gets the identity.
    fn of(shape: &MaskShape, reply: &'a [u32], identity: &'a mut Vec<u32>, n: u32) -> Self {
        let of = |span: &Span| span.of(reply).unwrap_or_default();
        match shape {
            MaskShape::Sparse { rows, blocks, bits, order: Some(order) } => {
                Self { rows: of(rows), blocks: of(blocks), bits: of(bits), order: of(order) }
            }
            MaskShape::Sparse { rows, blocks, bits, order: None } => {
                identity.clear();
                identity.extend(0..n);
                Self { rows: of(rows), blocks: of(blocks), bits: of(bits), order: identity }
            }
            MaskShape::Dense { .. } => unreachable!("the sparse encoding was asked for"),
        }
    }
}

impl Task {
    fn run(&mut self, candidates: &Candidates<'_>, balls: &[Ball]) {
        self.found.clear();
        let ball = |position: u32| &balls[candidates.order[position as usize] as usize];
        for word in self.words.clone() {
            let (row, block) = (candidates.rows[word], candidates.blocks[word]);
            let one = ball(row);
            let (mut bits, mut rest) = (0, candidates.bits[word]);
            while rest != 0 {
                let column = rest.trailing_zeros();
                bits |= u32::from(one.overlaps(ball(32 * block + column))) << column;
                rest &= rest - 1;
            }
            self.found.push(row, block, bits);
        }
    }
}
