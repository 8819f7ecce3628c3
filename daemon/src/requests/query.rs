//! Requests that ask which boxes of a scene other boxes overlap.

use std::time::Instant;

use pairmask_core::engine::{CullError, ReplyBuffer};
use pairmask_core::scene::QueryError;
use pairmask_core::units::BoxCount;
use pairmask_wire::{QueryRequest, Reject};

use super::Served;
use super::scene::SceneEdits;
use crate::clients::{GpuNeed, KeptScene};
use crate::publish::{OpenRequest, Outbox, Refusal};

/// Words of a pair.
const PAIR_WORDS: u64 = 2;

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
                let mut answer =
                    || query_and_answer(&mut kept, &mut open, request, threads, outbox);
                let answered = if threads == 1 { answer() } else { self.pool.work(answer) };
                if kept.scene.scene().engine().is_gpu() {
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
        Served { threads, gpu, ..Served::BEGUN }
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
    let KeptScene { scene, room, audited, .. } = kept;
    scene.scene_mut().set_threads(threads);
    let taken_at = open.taken_at();
    let index_end = request.mask.index_end();
    let begun = Instant::now();
    let answer = {
        let (pages, mut reply) = open.payload_and_reply();
        let malformed = || Unanswered::Refused(Reject::Query { field: "payload" }.into());
        let (queries, tags) = request.read(pages).ok_or_else(malformed)?;
        scene.scene_mut().limit_query_pairs(reply.limit_words() / PAIR_WORDS);
        request.mask.answer(queries, request.encoding, threads, &mut reply, |found| {
            let tested = scene.query(queries, tags, found)?;
            if found.iter().any(|[_, index]| *index >= index_end) {
                return Err(Unanswered::Refused(Reject::Query { field: "object count" }.into()));
            }
            Ok::<_, Unanswered>(tested)
        })
    };
    room.note(scene);
    let mut answer = answer?;
    answer.engine = scene.scene().engine();
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

impl From<CullError> for Unanswered {
    fn from(error: CullError) -> Self {
        Self::Refused(error.into())
    }
}
