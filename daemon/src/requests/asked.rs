//! What scenes are asked: queries and casts.

use std::time::Instant;

use pairmask_core::BoxCount;
use pairmask_core::cast::HIT_BYTES;
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{CullError, ReplyBuffer};
use pairmask_core::precision::BoxSlice;
use pairmask_core::scene::{BeyondMask, Cast, QueryError};
use pairmask_transport::Memory;
use pairmask_wire::{CastRequest, QueryRequest, Reject, SceneId, response_cast};

use super::PAIR_BYTES;
use super::scene::Failed;
use crate::audit::AuditedScene;
use crate::execute::SceneHost;
use crate::publish::{Found, OpenRequest, Outbox, Refusal};

/// Most pairs whose memory a scene keeps between queries: 8 MiB, 2,048 pages. To find more takes far longer than
/// to map their memory.
const MOST_KEPT_PAIRS: usize = 1 << 20;

/// Words of a hit in a reply.
const HIT_WORDS: u64 = (HIT_BYTES / size_of::<u32>()) as u64;

/// A request that asks a scene, and changes nothing.
#[derive(Clone, Copy)]
pub(super) enum Asked<'a> {
    Query(&'a QueryRequest),
    Cast(&'a CastRequest),
}

impl Asked<'_> {
    pub const fn scene(&self) -> SceneId {
        match self {
            Self::Query(request) => request.scene,
            Self::Cast(request) => request.scene,
        }
    }

    /// `None` asks a shared scene.
    pub const fn revision(&self) -> Option<u64> {
        match self {
            Self::Query(request) => request.revision,
            Self::Cast(request) => request.revision,
        }
    }

    pub const fn threads(&self) -> Option<usize> {
        match self {
            Self::Query(request) => request.threads,
            Self::Cast(request) => request.threads,
        }
    }

    /// Boxes, rays or spheres.
    pub const fn count(&self) -> u32 {
        match self {
            Self::Query(request) => request.mask.queries(),
            Self::Cast(request) => request.count(),
        }
    }

    /// Whether a GPU finds all that it asks for, in a scene where it is kept, with nothing left to decide.
    pub const fn is_of_gpu(&self, scene: &SceneHost) -> bool {
        matches!(self, Self::Query(_)) && scene.engine().is_gpu()
    }

    /// Answers it, with memory for the pairs of a query, and with the scene's audit if it has one.
    pub fn answer(
        &self,
        of: (&mut SceneHost, &mut Vec<[u32; 2]>, Option<&AuditedScene>),
        open: &mut OpenRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Result<(), Failed> {
        match self {
            Self::Query(request) => answer_query(request, of, open, threads, outbox),
            Self::Cast(request) => answer_cast(request, of.0, open, threads, outbox),
        }
    }
}

/// Why a query has no answer.
fn unanswered(error: QueryError) -> Failed {
    match error {
        // Its boxes are lost with the device's memory: the client sends them again.
        QueryError::Cull(CullError::DeviceLost { .. }) => Failed::Lost(Refusal::stale_scene(0)),
        QueryError::Cull(error) => error.into(),
        // Whether there is enough filter data was checked with the header.
        _ => Reject::Query("filter data").into(),
    }
}

/// Answers a query of a scene, with memory for what is found, and with its audit if it has one.
fn answer_query(
    request: &QueryRequest,
    (scene, found, audited): (&mut SceneHost, &mut Vec<[u32; 2]>, Option<&AuditedScene>),
    open: &mut OpenRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Failed> {
    scene.set_threads(threads);
    scene.limit_query_pairs(open.limit_pairs());
    let all = (scene.len() as u64).saturating_mul(request.mask.queries().into());
    let most = PAIR_BYTES.saturating_mul(all.min(open.limit_pairs()));
    let _found = open.share().charge(Memory::Own, most)?;
    let taken_at = open.taken_at;
    let begun = Instant::now();
    let answer = {
        let (pages, mut reply) = open.payload_and_reply();
        let malformed = Reject::Query("payload");
        let (queries, filter_data) = request.read(pages).ok_or(malformed)?;
        request.mask.answer(queries, request.encoding, threads, found, &mut reply, |found| {
            scene.query(queries, filter_data, found).map_err(unanswered)
        })
    };
    if found.capacity() > MOST_KEPT_PAIRS {
        *found = Vec::new();
    }
    let mut answer = answer?;
    answer.engine = scene.engine();
    answer.times.ingest_ns = begun.duration_since(taken_at).as_nanos() as u64;
    let queries = BoxCount::new(request.mask.queries());
    if let Some(window) = outbox.answer_query(open, queries, answer, audited)
        && let Some((queries, filter_data)) = request.read(open.pages())
    {
        outbox.auditor.submit(window, BoxSlice::from(queries).into(), None, &filter_data);
    }
    Ok(())
}

/// Answers a cast into a scene.
fn answer_cast(
    request: &CastRequest,
    scene: &mut SceneHost,
    open: &mut OpenRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Failed> {
    scene.set_threads(threads);
    let (begun, mut found) = (Instant::now(), Vec::new());
    let ingest_ns = begun.duration_since(open.taken_at).as_nanos() as u64;
    let (pages, mut reply) = open.payload_and_reply();
    let (shapes, filter_data) = request.read(pages).ok_or(Reject::Query("payload"))?;
    let most_hits = reply.limit_words() / HIT_WORDS;
    let cast = Cast { shapes, hits: request.hits, filter_data, most_hits };
    let engine = scene.cast(&cast, &mut found).map_err(unanswered)?;
    let executed = Instant::now();
    let words = reply.reserve(HIT_WORDS * found.len() as u64).map_err(CullError::from)?;
    let hits: &[u32] = bytemuck::cast_slice(&found);
    words[..hits.len()].copy_from_slice(hits);
    let times = StageTimes {
        ingest_ns,
        execute_ns: executed.duration_since(begun).as_nanos() as u64,
        publish_ns: executed.elapsed().as_nanos() as u64,
        total_ns: open.taken_at.elapsed().as_nanos() as u64,
        ..StageTimes::default()
    };
    let header = response_cast(&open.fields, engine, threads, found.len(), &times);
    outbox.count_cast(open, &Found { pairs: found.len() as u64, engine, threads, times });
    open.send(&header);
    Ok(())
}

impl From<BeyondMask> for Refusal {
    fn from(_: BeyondMask) -> Self {
        Reject::Query("object count").into()
    }
}
