//! The in-process side of a session: engines, and buffers that are reused.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pairmask_core::aabb::Aabb;
use pairmask_core::dispatch::{CpuEngines, CullAnswer, CullOptions, SphereWays, WorldRange};
use pairmask_core::engine::{AvailableIsa, CullError, HeapReply, ReserveError};
use pairmask_core::filters::Rules;
use pairmask_core::objects::Objects;
use pairmask_core::plan::Calibration;
use pairmask_core::precision::{ExpandScratch, Precision};
use pairmask_core::repeat::{Repeats, Seen};
use pairmask_core::scene::{QueryError, cull_between};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_core::usable_memory;
use pairmask_wire::Reply;

use super::builder::Settings;
use super::frame::Written;
use super::pace::{Pace, Working};
use super::pairs::{PairMask, ServedBy, Storage};
use super::scene::Asked;

/// Bytes of the largest mask where another encoding may be smaller: a daemon's default.
const MOST_REPLY_BYTES: u64 = 1 << 30;
/// Memory from this size on is compared with what the process may use, which takes the reading of some files.
const LARGE_BYTES: u64 = 64 << 20;
/// Buffers of each kind that are kept for reuse: those of two frames under way and of one being
/// filled, and one of a mask that is held.
const KEPT_BUFFERS: usize = 4;

/// Engines and spare buffers of one session.
pub(super) struct Local {
    engines: Mutex<Engines>,
    replies: Shelf<HeapReply>,
    spares: Spares,
    /// Memory for what queries find, so that it is not mapped for each anew.
    found: Shelf<Vec<[u32; 2]>>,
    last_pairs: Mutex<Option<u64>>,
    pace: Pace,
}

/// The engines for boxes and for spheres, and what is remembered of the last frame.
struct Engines {
    boxes: CpuEngines,
    spheres: SphereWays,
    repeats: Repeats,
}

impl Engines {
    /// Finds the pairs, or knows them of the last frame.
    fn cull(
        &mut self,
        objects: Objects<'_>,
        options: &CullOptions,
        may_repeat: bool,
        reply: &mut HeapReply,
    ) -> Result<CullAnswer, CullError> {
        let mut seen = Seen::New;
        if may_repeat {
            seen = self.repeats.look(objects, options, 0, reply);
        }
        if let Seen::Answered(answer) = seen {
            return Ok(answer);
        }
        let answer = match objects {
            Objects::Boxes(these) => {
                let mut scratch = ExpandScratch::default();
                self.boxes.cull(these.expand(&mut scratch, true), options, reply)
            }
            Objects::Spheres(these) => self.spheres.cull(&mut self.boxes, these, options, reply),
        }?;
        if seen == Seen::Alike
            && let Some(ticket) = self.repeats.ticket()
        {
            ticket.keep(objects, reply.words(), &answer, 0);
        }
        Ok(answer)
    }
}

/// Spare buffers for the objects of frames.
#[derive(Default)]
pub struct Spares {
    pub boxes: Shelf<Vec<Aabb>>,
    pub spheres: Shelf<Vec<Sphere>>,
}

/// A few buffers for reuse.
pub struct Shelf<T>(Mutex<Vec<T>>);

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::with_capacity(KEPT_BUFFERS)))
    }
}

impl<T: Default> Shelf<T> {
    fn take(&self) -> T {
        lock(&self.0).pop().unwrap_or_default()
    }

    /// Keeps a buffer, unless [`KEPT_BUFFERS`] are kept.
    pub(super) fn give(&self, item: T) {
        let mut kept = lock(&self.0);
        if kept.len() < KEPT_BUFFERS {
            kept.push(item);
        }
    }
}

impl<T: Clone + Default> Shelf<Vec<T>> {
    /// Memory for `n` items, contents unspecified; `None` where the system has none.
    pub(super) fn take_sized(&self, n: BoxCount) -> Option<Vec<T>> {
        let mut things = self.take();
        // A system that lends more than it has kills whoever touches it. An engine needs as much again.
        let bytes = size_of::<T>() as u64 * u64::from(n.get());
        let is_too_much = |usable| 2 * bytes > usable;
        let is_new = n.len() > things.capacity();
        if is_new && bytes > LARGE_BYTES && usable_memory::bytes().is_some_and(is_too_much) {
            return None;
        }
        things.try_reserve_exact(n.len().saturating_sub(things.len())).ok()?;
        things.resize(n.len(), T::default());
        Some(things)
    }
}

impl std::fmt::Debug for Local {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Local")
    }
}

/// Locks a mutex, a poisoned one too: the next frame overwrites the scratch memory that a panicking
/// engine left.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Local {
    pub(super) fn new(isa: AvailableIsa) -> Self {
        let boxes = CpuEngines::on(isa, Calibration::built_in(isa.get()));
        Self {
            engines: Mutex::new(Engines {
                boxes,
                spheres: SphereWays::on(isa),
                repeats: Repeats::default(),
            }),
            replies: Shelf::default(),
            spares: Spares::default(),
            found: Shelf::default(),
            last_pairs: Mutex::default(),
            pace: Pace::default(),
        }
    }

    pub(super) const fn spares(&self) -> &Spares {
        &self.spares
    }

    /// Work of this process begins.
    pub(super) fn begin(&self) -> Working<'_> {
        self.pace.begin()
    }

    pub(super) fn give_reply(&self, reply: HeapReply) {
        self.replies.give(reply);
    }

    /// Finds the pairs with the engines of this process. Rules are for boxes.
    pub(super) fn cull(
        self: &Arc<Self>,
        objects: Objects<'_>,
        rules: Option<&Rules>,
        written: Written,
        settings: &Settings,
    ) -> Result<PairMask, CullError> {
        let mut working = self.begin();
        let mut memory = self.replies.take();
        let options = CullOptions {
            engine: settings.engine,
            encoding: settings.encoding,
            threads: settings.threads,
            visit_threads: settings.visit_threads,
            last_pairs: *lock(&self.last_pairs),
            ..CullOptions::default()
        };
        let mut worlds = Vec::new();
        let mut find = |limit_bytes| {
            memory.set_limit_bytes(limit_bytes);
            self.find(
                objects,
                rules,
                written.first_set,
                &options,
                settings,
                &mut memory,
                &mut worlds,
            )
        };
        // As a daemon does: what is too large in one encoding is found in another, where that is left open. Where no
        // encoding is small enough, memory is the limit.
        let answer = match find(MOST_REPLY_BYTES) {
            Err(CullError::Reserve(ReserveError::TooLarge { .. })) => find(u64::MAX),
            done => done,
        }?;
        *lock(&self.last_pairs) = Some(answer.report.pair_count);
        working.used(answer.threads);
        let n = BoxCount::new(objects.len() as u32);
        Ok(self.mask(memory, n, &answer, written, settings).with_worlds(worlds))
    }

    /// Finds the pairs in memory that the mask may take.
    #[allow(clippy::too_many_arguments)] // All that a frame is.
    fn find(
        &self,
        objects: Objects<'_>,
        rules: Option<&Rules>,
        first_set: Option<BoxCount>,
        options: &CullOptions,
        settings: &Settings,
        memory: &mut HeapReply,
        worlds: &mut Vec<WorldRange>,
    ) -> Result<CullAnswer, CullError> {
        match (objects, rules, first_set) {
            (Objects::Boxes(these), None, Some(first)) => {
                cull_between(&mut lock(&self.engines).boxes, these, first, options, memory)
            }
            (Objects::Boxes(these), Some(rules), _) => {
                let mut scratch = ExpandScratch::default();
                let these = these.expand(&mut scratch, true);
                let engines = &mut lock(&self.engines).boxes;
                let filtered = engines.cull_filtered(these, rules, options, memory)?;
                worlds.clear();
                worlds.extend_from_slice(filtered.worlds);
                Ok(filtered.answer)
            }
            _ => lock(&self.engines).cull(objects, options, settings.answer_repeats, memory),
        }
    }

    /// The mask of what `find` finds for queries, with so many threads.
    pub(super) fn query(
        self: &Arc<Self>,
        asked: &Asked<'_>,
        threads: usize,
        settings: &Settings,
        find: impl FnOnce(&mut Vec<[u32; 2]>) -> Result<u64, QueryError>,
    ) -> Result<PairMask, QueryError> {
        let mut working = self.begin();
        let Asked { boxes, encoding, mask, .. } = *asked;
        let (mut memory, mut found) = (self.replies.take(), self.found.take());
        let answer = mask.answer(boxes, encoding, threads, &mut found, &mut memory, find)?;
        self.found.give(found);
        working.used(answer.threads);
        let written = Written::by(&Precision::Exact);
        Ok(self.mask(memory, mask.n(), &answer, written, settings))
    }

    /// The mask of an answer of this process.
    fn mask(
        self: &Arc<Self>,
        memory: HeapReply,
        n: BoxCount,
        answer: &CullAnswer,
        written: Written,
        settings: &Settings,
    ) -> PairMask {
        let reply = Reply {
            box_count: n,
            engine: answer.engine.into(),
            threads: answer.threads,
            report: answer.report,
            times: answer.times,
        };
        let storage = Storage::Own { memory, home: Arc::clone(self) };
        PairMask::new(storage, &reply, ServedBy::InProcess, written, settings.isa)
    }
}
