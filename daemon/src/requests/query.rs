//! Requests that ask which boxes of a scene other boxes overlap.

use std::time::Instant;

use pairmask_core::engine::CullError;
use pairmask_core::scene::{BeyondMask, QueryError};
use pairmask_core::units::BoxCount;
use pairmask_wire::{QueryRequest, Reject};

use super::Served;
use super::scene::SceneEdits;
use crate::clients::{GpuNeed, KeptScene};
use crate::publish::{OpenRequest, Outbox, Refusal};

/// Most queries of a scene in video memory that are answered without the pool: 24 bytes each, so that the copy
/// to where the GPU sees them is one thread's.
const FEW_QUERIES: u32 = 1 << 15;

impl SceneEdits {
    /// Answers a query.
    pub(super) fn query(
        &self,
        mut open: OpenRequest,
        request: &QueryRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Served {
        let threads = request.threads.map_or(threads, |asked| asked.min(threads)).max(1);
        let session = open.sender().session;
        let mut gpu = GpuNeed::None;
        let answered = match Self::find_at(session, request.scene, request.revision, outbox) {
            Ok(mut kept) => {
                let is_there = kept.scene.engine().is_gpu();
                let mut answer =
                    || query_and_answer(&mut kept, &mut open, request, threads, outbox);
                // A scene in video memory has work for the pool only where its queries fill a copy of several
                // threads. Else a thread of it would be woken for nothing.
                let answered =
                    if threads == 1 || (is_there && request.mask.queries() <= FEW_QUERIES) {
                        answer()
                    } else {
                        self.0.pool.work(answer)
                    };
                if is_there {
                    gpu = GpuNeed::Alone;
                }
                // Its boxes are gone with the device's memory: the client sends them again.
                let is_lost = matches!(answered, Err(Unanswered::Lost));
                if !is_lost {
                    outbox.clients().keep_scene(session, kept);
                }
                answered.map_err(|why| match why {
                    Unanswered::Lost => Refusal::stale_scene(0),
                    Unanswered::Refused(refusal) => refusal,
                })
            }
            Err(refusal) => Err(refusal),
        };
        if let Err(refusal) = &answered {
            outbox.refuse(&mut open, refusal);
        }
        open.close();
        Served { threads, on_gpu: gpu != GpuNeed::None, gpu, ..Served::BEGUN }
    }
}

/// Why a query has no answer.
enum Unanswered {
    Refused(Refusal),
    /// The scene was in video memory that is gone.
    Lost,
}

impl From<QueryError> for Unanswered {
    fn from(error: QueryError) -> Self {
        match error {
            QueryError::Cull(CullError::DeviceLost { .. }) => Self::Lost,
            QueryError::Cull(error) => Self::Refused(error.into()),
            // Whether there are enough tags was checked with the header.
            _ => Self::Refused(Reject::Query { field: "tags" }.into()),
        }
    }
}

fn query_and_answer(
    kept: &mut KeptScene,
    open: &mut OpenRequest,
    request: &QueryRequest,
    threads: usize,
    outbox: &Outbox,
) -> Result<(), Unanswered> {
    let KeptScene { scene, scratch, found, room, audited, .. } = kept;
    scene.set_threads(threads);
    scene.limit_query_pairs(open.limit_pairs());
    let taken_at = open.taken_at();
    let begun = Instant::now();
    let answer = {
        let (pages, mut reply) = open.payload_and_reply();
        let malformed = || Unanswered::Refused(Reject::Query { field: "payload" }.into());
        let (queries, tags) = request.read(pages).ok_or_else(malformed)?;
        let pairs = found.pairs();
        request.mask.answer(queries, request.encoding, threads, pairs, &mut reply, |found| {
            scene.query(queries, tags, found).map_err(Unanswered::from)
        })
    };
    found.tidy();
    room.note(scene, found.bytes() + scratch.allocated_bytes() as u64);
    let mut answer = answer?;
    answer.engine = scene.engine();
    answer.times.ingest_ns = begun.duration_since(taken_at).as_nanos() as u64;
    let queries = BoxCount::new(request.mask.queries());
    let window = outbox.answer_query(open, queries, answer, audited.as_ref());
    if let (Some(scene), Some(window)) = (audited, window)
        && let Some((queries, tags)) = request.read(open.pages())
    {
        outbox.audit_query(scene, window, queries, &tags);
    }
    Ok(())
}

impl From<BeyondMask> for Unanswered {
    fn from(_: BeyondMask) -> Self {
        Self::Refused(Reject::Query { field: "object count" }.into())
    }
}

impl From<CullError> for Unanswered {
    fn from(error: CullError) -> Self {
        Self::Refused(error.into())
    }
}
