//! Queries of a scene: which of its boxes some other boxes overlap.

use std::time::Duration;

use pairmask_core::aabb::Aabb;
use pairmask_core::engine::EngineId;
use pairmask_core::mask::{Encoding, MaskView};
use pairmask_core::pacing::{Answered, Estimate};
use pairmask_core::precision::Precision;
use pairmask_core::scene::{QueryFilterData, QueryMask, Scene as CoreScene};
use pairmask_wire::{QueryRequest, Reply, ReplyError, ReplyFields, RequestHeader, words_in};

use super::backend::{Scene, SceneBackend};
use super::question::{Asked, Question};
use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::link::Exchange;
use crate::session::local::Query;
use crate::session::pairs::{FrameInfo, PairMask, ServedBy, Storage};
use crate::session::written::Written;

/// Pairs that are handed out at a time.
const SLICE: usize = 256;

impl Scene {
    /// Asks which boxes of the scene some other boxes overlap: boxes, [points](Aabb::point), or what moving
    /// boxes touch ([`Aabb::swept`]). Boxes that are disabled are not found; those of all worlds are.
    ///
    /// It asks the scene as the last edit made it, with the boxes as they were set, and changes nothing that edits
    /// report. Where the daemon has lost the scene, it is sent again. Of boxes with margins, the inflated ones are looked
    /// at first: their pairs have to fit the limits of an answer.
    ///
    /// A shared scene is asked for the boxes of all members, regardless of the scope of this one's reports, as the last
    /// tick made it: an edit that waits for the end of its tick is not part of it. Its queries need a daemon.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x; 3], [x + 1.0; 3]);
    /// scene.edit().set(7, at(0.0)).set(9, at(5.0)).commit(Report::Nothing)?;
    ///
    /// let bullet = at(3.0).swept_by([2.5, 2.5, 2.5]);
    /// let found = scene.query(&[Aabb::point([0.5; 3]), bullet])?;
    /// assert!(found.iter().eq([[0, 7], [1, 9]]));
    /// assert!(found.of_query(1).eq([9]));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error`].
    pub fn query(&mut self, boxes: &[Aabb]) -> Result<QueryAnswer, Error> {
        self.query_filtered(boxes, QueryFilterData::None)
    }

    /// Finds only what may meet boxes with the given filter data: one [`FilterData`](crate::filters::FilterData) for all
    /// queries, or a slice with one for each. The scene's [filters](crate::filters) decide, except for the include and
    /// the exclude list.
    ///
    /// # Errors
    /// [`Error`].
    pub fn query_filtered<'t>(
        &mut self,
        boxes: &[Aabb],
        filter_data: impl Into<QueryFilterData<'t>>,
    ) -> Result<QueryAnswer, Error> {
        self.query_as(boxes, filter_data.into(), Encoding::List)
    }

    /// The same with an answer whose [mask](QueryAnswer::mask) is no list.
    ///
    /// # Errors
    /// [`Error`].
    pub fn query_as(
        &mut self,
        boxes: &[Aabb],
        filter_data: QueryFilterData<'_>,
        encoding: Encoding,
    ) -> Result<QueryAnswer, Error> {
        filter_data.check(boxes.len())?;
        let index_end = match &self.backend {
            SceneBackend::Remote(remote) => remote.index_end(),
            SceneBackend::Here(here) => here.index_end(),
        };
        let too_many = Error::TooManyQueries { queries: boxes.len(), index_end };
        let asked = Query {
            boxes,
            filter_data,
            encoding,
            mask: QueryMask::new(boxes.len(), index_end).ok_or(too_many)?,
        };
        let mask = self.backend.ask(&self.core, &asked)?;
        let FrameInfo { served_by, engine, .. } = *mask.info();
        let mut answer = QueryAnswer { mask, queries: asked.mask.queries(), served_by, engine };
        if let Some(margins) = &self.margins {
            let touches = |[query, index]: &[u32; 2]| {
                let found = margins.now().get(*index);
                // Boxes of other members are not here.
                found.is_none_or(|found| found.overlaps(&boxes[*query as usize]))
            };
            let found: Vec<_> = answer.iter().filter(touches).collect();
            answer.mask = self.core.local().mask_of(&asked, &found)?;
        }
        Ok(answer)
    }
}

impl Question for Query<'_> {
    type Answer = PairMask;

    fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    fn ask_here(&self, core: &Core, scene: &mut CoreScene) -> Result<PairMask, Error> {
        Ok(core.local().query(scene, self)?)
    }

    fn ask(&self, asked: Asked<'_>, estimate: &mut Estimate) -> Result<PairMask, Error> {
        let Self { boxes, filter_data, encoding, mask } = *self;
        let Asked { core, link, scene, revision, threads, .. } = asked;
        let mut request = QueryRequest::new(scene, revision, mask, encoding, &filter_data);
        request.threads = threads;
        let mut shared = core.loan(link, request.payload_bytes())?;
        if !request.write(boxes, &filter_data, shared.loan.pages_mut()) {
            let limit = u64::from(u32::MAX);
            return Err(Error::TooManyBoxes { n: boxes.len(), limit });
        }
        let asked = ReplyFields {
            client_token: link.token(),
            frame: core.next_frame(),
            box_count: mask.n(),
        };
        let header = RequestHeader::query_scene(asked.client_token, asked.frame, &request);
        let exchange = Exchange::begin(shared, &header)?;
        let settings = core.settings();
        let answer = core.end(exchange, estimate.expect(mask.queries()))?;
        let payload_bytes = size_of_val(answer.memory.pages()) as u64;
        let reply = Reply::parse(&answer.header, &asked, payload_bytes).map_err(Error::from)?;
        MaskView::new(mask.n(), &reply.report.shape, words_in(answer.memory.pages()))
            .map_err(|_| Error::from(ReplyError::Malformed { field: "mask" }))?;
        estimate.note(Answered {
            n: mask.queries(),
            round_trip: answer.round_trip,
            took: Duration::from_nanos(reply.times.total_ns),
            threads: reply.threads,
        });
        let written = Written::by(&Precision::Exact);
        let storage = Storage::Shared(answer.memory);
        Ok(PairMask::new(storage, &reply, ServedBy::Daemon, written, settings.isa))
    }
}

/// The boxes of a scene that some other boxes overlap: pairs [query, index], by query and then by index.
///
/// Regardless of what another process writes into it, every query and index is one that there may be. An answer of a
/// daemon holds one of the session's three slots for frames until it is dropped.
#[derive(Debug)]
pub struct QueryAnswer {
    mask: PairMask,
    queries: u32,
    served_by: ServedBy,
    engine: EngineId,
}

impl QueryAnswer {
    /// How many pairs.
    pub const fn count(&self) -> u64 {
        self.mask.count()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// How many queries there were: one for each box that was given.
    pub const fn queries(&self) -> u32 {
        self.queries
    }

    /// Indices are below this.
    pub const fn index_end(&self) -> u32 {
        self.mask.n().get() - self.queries
    }

    /// The pairs one by one.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let queries = self.queries;
        let pair = move |[a, b]: [u32; 2]| Some([a, b.checked_sub(queries)?]);
        self.mask.pairs().filter(move |[a, _]| *a < queries).filter_map(pair)
    }

    /// The pairs in slices: the fastest way to iterate over all.
    pub fn for_each_slice(&self, mut f: impl FnMut(&[[u32; 2]])) {
        let mut some = [[0; 2]; SLICE];
        self.mask.for_each_slice(|pairs| {
            for pairs in pairs.chunks(SLICE) {
                let mut wrong = false;
                for (to, [a, b]) in some.iter_mut().zip(pairs) {
                    *to = [*a, b.wrapping_sub(self.queries)];
                    wrong |= *a >= self.queries || *b < self.queries;
                }
                let mut len = pairs.len();
                if wrong {
                    let right = |[a, b]: &&[u32; 2]| *a < self.queries && *b >= self.queries;
                    len = 0;
                    for [a, b] in pairs.iter().filter(right) {
                        some[len] = [*a, b - self.queries];
                        len += 1;
                    }
                }
                f(&some[..len]);
            }
        });
    }

    /// The indices that one query has found. In a list they are searched for; in another form all pairs are
    /// looked through.
    pub fn of_query(&self, query: u32) -> impl Iterator<Item = u32> + '_ {
        let view = self.mask.view();
        let (listed, others) = match &view {
            MaskView::List(list) => {
                let pairs = list.as_pairs();
                let start = pairs.partition_point(|[a, _]| *a < query);
                let end = start + pairs[start..].partition_point(|[a, _]| *a <= query);
                (&pairs[start..end], None)
            }
            _ => (&[][..], Some(self.iter())),
        };
        let (queries, end) = (self.queries, self.index_end());
        let listed = listed
            .iter()
            .filter_map(move |[a, b]| {
                (*a == query && *a < queries).then(|| b.checked_sub(queries))?
            })
            .filter(move |index| *index < end);
        let others = others.into_iter().flatten().filter(move |[a, _]| *a == query);
        listed.chain(others.map(|[_, index]| index))
    }

    /// The pairs.
    pub fn to_vec(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::new();
        self.for_each_slice(|some| pairs.extend_from_slice(some));
        pairs
    }

    /// The answer as a mask, with all ways to decode it. Query q is object q of the mask; the box of index i is
    /// object [`queries`](Self::queries) + i.
    pub const fn mask(&self) -> &PairMask {
        &self.mask
    }

    /// What answered.
    pub const fn served_by(&self) -> ServedBy {
        self.served_by
    }

    /// The engine that answered. It may be one of a later daemon that this build does not know.
    pub const fn engine(&self) -> EngineId {
        self.engine
    }
}
