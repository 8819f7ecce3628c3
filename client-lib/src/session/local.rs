//! The in-process side of a session: its engines.

use std::sync::{Arc, Mutex};

use pairmask_core::aabb::Aabb;
use pairmask_core::dispatch::{CpuEngines, CullAnswer, CullOptions, SphereWays, WorldRange};
use pairmask_core::engine::{CullError, HeapReply, ReserveError};
use pairmask_core::filters::Rules;
use pairmask_core::mask::Encoding;
use pairmask_core::objects::Objects;
use pairmask_core::plan::Calibration;
use pairmask_core::precision::{ExpandScratch, Precision};
use pairmask_core::repeat::{Repeats, Seen};
use pairmask_core::scene::{QueryError, QueryFilterData, QueryMask, Scene, cull_between};
use pairmask_core::units::BoxCount;
use pairmask_wire::Reply;

use super::pairs::{PairMask, ServedBy, Storage};
use super::settings::Settings;
use super::spares::{Spares, lock};
use super::written::Written;

/// Bytes of the largest mask where another encoding may be smaller: a daemon's default.
const MOST_REPLY_BYTES: u64 = 1 << 30;
/// What a query of a scene asks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Query<'a> {
    pub boxes: &'a [Aabb],
    pub filter_data: QueryFilterData<'a>,
    pub encoding: Encoding,
    pub mask: QueryMask,
}

/// Engines and spare buffers of one session.
pub(super) struct Local {
    engines: Mutex<Engines>,
    spares: Arc<Spares>,
    last_pairs: Mutex<Option<u64>>,
    settings: Settings,
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

impl std::fmt::Debug for Local {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Local")
    }
}

impl Local {
    pub(super) fn new(settings: Settings) -> Self {
        let isa = settings.isa;
        let boxes = CpuEngines::on(isa, Calibration::built_in(isa.get()));
        Self {
            engines: Mutex::new(Engines {
                boxes,
                spheres: SphereWays::on(isa),
                repeats: Repeats::default(),
            }),
            spares: Arc::default(),
            last_pairs: Mutex::default(),
            settings,
        }
    }

    pub(super) fn spares(&self) -> &Spares {
        &self.spares
    }

    /// Finds the pairs with the engines of this process. Rules are for boxes.
    pub(super) fn cull(
        &self,
        objects: Objects<'_>,
        rules: Option<&Rules>,
        written: Written,
    ) -> Result<PairMask, CullError> {
        let settings = &self.settings;
        let mut memory = self.spares.replies.take();
        let options = CullOptions {
            engine: settings.engine,
            encoding: settings.encoding,
            threads: settings.threads,
            iterate_threads: settings.iterate_threads,
            last_pairs: *lock(&self.last_pairs),
            ..CullOptions::default()
        };
        let mut worlds = Vec::new();
        let mut find = |limit_bytes| {
            memory.set_limit_bytes(limit_bytes);
            self.find(objects, rules, written.first_set, &options, &mut memory, &mut worlds)
        };
        // As a daemon does: what is too large in one encoding is found in another, where that is left open. Where no
        // encoding is small enough, memory is the limit.
        let answer = match find(MOST_REPLY_BYTES) {
            Err(CullError::Reserve(ReserveError::TooLarge { .. })) => find(u64::MAX),
            done => done,
        }?;
        *lock(&self.last_pairs) = Some(answer.report.pair_count);
        let n = BoxCount::new(objects.len() as u32);
        Ok(self.mask(memory, n, &answer, written).with_worlds(worlds))
    }

    /// Finds the pairs in memory that the mask may take.
    #[allow(clippy::too_many_arguments)] // All that a frame is.
    fn find(
        &self,
        objects: Objects<'_>,
        rules: Option<&Rules>,
        first_set: Option<BoxCount>,
        options: &CullOptions,
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
            _ => lock(&self.engines).cull(objects, options, self.settings.answer_repeats, memory),
        }
    }

    /// Asks a scene of this process.
    pub(super) fn query(
        &self,
        scene: &mut Scene,
        asked: &Query<'_>,
    ) -> Result<PairMask, QueryError> {
        let threads = scene.threads();
        self.found(asked, threads, |found| scene.query(asked.boxes, asked.filter_data, found))
    }

    /// The mask of pairs [query, index] that are known, by query and then by index.
    pub(super) fn mask_of(
        &self,
        asked: &Query<'_>,
        known: &[[u32; 2]],
    ) -> Result<PairMask, QueryError> {
        self.found(asked, 1, |found| {
            found.extend_from_slice(known);
            Ok(known.len() as u64)
        })
    }

    /// The mask of what `find` finds for queries, with so many threads.
    fn found(
        &self,
        asked: &Query<'_>,
        threads: usize,
        find: impl FnOnce(&mut Vec<[u32; 2]>) -> Result<u64, QueryError>,
    ) -> Result<PairMask, QueryError> {
        let Query { boxes, encoding, mask, .. } = *asked;
        let (mut memory, mut found) = (self.spares.replies.take(), self.spares.found.take());
        let answer = mask.answer(boxes, encoding, threads, &mut found, &mut memory, find)?;
        self.spares.found.give(found);
        let written = Written::by(&Precision::Exact);
        Ok(self.mask(memory, mask.n(), &answer, written))
    }

    /// The mask of an answer of this process.
    fn mask(
        &self,
        memory: HeapReply,
        n: BoxCount,
        answer: &CullAnswer,
        written: Written,
    ) -> PairMask {
        let reply = Reply {
            box_count: n,
            engine: answer.engine.into(),
            threads: answer.threads,
            report: answer.report,
            times: answer.times,
        };
        let storage = Storage::Own { memory, home: Arc::clone(&self.spares) };
        PairMask::new(storage, &reply, ServedBy::InProcess, written, self.settings.isa)
    }
}
