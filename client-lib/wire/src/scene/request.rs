//! The header of an edit.

use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::Report;

use crate::header::{Operation, RequestHeader, engine_number, thread_number, threads_of};
use crate::reject::Reject;
use crate::section::{Section, SectionKind, find, slots};

/// A client's number of one of its scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SceneId(pub u32);

/// Flag of an edit: the client took the answer to the one before.
const TAKEN: u32 = 1;
/// Flag of an edit: the client knows pairs that this scene has not reported, so that the next changes are
/// all pairs.
const LOST: u32 = 1 << 1;

/// Flag of an edit: the pairs after it count as reported. How many there are say [`RequestHeader::flags`], the low half,
/// and [`RequestHeader::iterate_threads`].
const REPORTED: u32 = 1 << 2;

/// An edit of a scene: what a client says in a header, and what a daemon has validated of one. What
/// changes lies in the payload ([`EditLayout`](super::EditLayout)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneRequest {
    /// The scene, among those of the session.
    pub scene: SceneId,
    /// The revision that the edit changes; 0 begins the scene anew, regardless of what there was.
    pub base: u64,
    /// The revision that it makes: not 0, and not the base.
    pub revision: u64,
    /// Whether the client took the answer to the edit that made the base.
    pub is_acknowledged: bool,
    /// Whether the client knows pairs that this scene has not reported.
    pub is_lost: bool,
    /// Of a client that goes back to a snapshot: the pairs after the edit, so many, count as reported.
    pub reported: Option<u64>,
    /// What is to be reported to it.
    pub report: Report,
    /// Indices are below this.
    pub most_boxes: u32,
    /// The engine asked for: one of a GPU keeps the scene in video memory.
    pub engine: EngineChoice,
    /// Threads that may be used; `None` leaves the number to the daemon.
    pub threads: Option<usize>,
    /// Boxes in the payload.
    pub boxes: Section,
    /// Steps in the payload.
    pub steps: Section,
    /// Words of indices in the payload.
    pub indices: Section,
}

/// The wire's number of what an edit asks for.
const fn report_number(report: Report) -> u32 {
    match report {
        Report::Changes => 1,
        Report::Moved => 2,
        Report::All => 3,
        // What a later core adds is of a later wire version.
        _ => 4,
    }
}

fn report_of(number: u32) -> Option<Report> {
    [Report::Changes, Report::Moved, Report::All, Report::Nothing]
        .into_iter()
        .find(|report| report_number(*report) == number)
}

impl RequestHeader {
    /// An edit of a scene.
    pub fn edit_scene(client_token: u64, frame: u64, request: &SceneRequest) -> Self {
        let flag = |on: bool, flag: u32| if on { flag } else { 0 };
        let reported = request.reported.unwrap_or(0);
        Self {
            flags: reported as u32,
            iterate_threads: (reported >> 32) as u32,
            box_count: (request.boxes.bytes / BOX_BYTES) as u32,
            engine: engine_number(request.engine),
            encoding: report_number(request.report),
            threads: thread_number(request.threads),
            sections: slots([request.boxes, request.steps, request.indices]),
            scene: request.scene.0,
            base: request.base,
            revision: request.revision,
            most_boxes: request.most_boxes,
            scene_flags: flag(request.is_acknowledged, TAKEN)
                | flag(request.is_lost, LOST)
                | flag(request.reported.is_some(), REPORTED),
            ..Self::envelope(Operation::EditScene, client_token, frame)
        }
    }

    /// A request to end a scene.
    pub fn end_scene(client_token: u64, frame: u64, scene: SceneId) -> Self {
        Self { scene: scene.0, ..Self::envelope(Operation::EndScene, client_token, frame) }
    }
}

/// More pairs than any scene has.
const MOST_PAIRS: u64 = 1 << 63;

/// Bytes of a box in f32.
pub(super) const BOX_BYTES: u64 = 24;

impl SceneRequest {
    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let report = report_of(header.encoding).ok_or(Reject::Edit("report"))?;
        let engine = header.engine_choice()?;
        if header.revision == 0 || header.revision == header.base {
            return Err(Reject::Edit("revision"));
        }
        let section = |kind, entry_bytes, field| {
            let section = find(&header.sections, kind, entry_bytes, payload_bytes);
            section.ok_or(Reject::Edit(field))
        };
        let boxes = section(SectionKind::Boxes, BOX_BYTES, "boxes")?;
        if boxes.bytes != BOX_BYTES * u64::from(header.box_count) {
            return Err(Reject::Edit("boxes"));
        }
        let is_reported = header.scene_flags & REPORTED != 0;
        let count = u64::from(header.iterate_threads) << 32 | u64::from(header.flags);
        // Of 2^32 boxes; sums of such numbers and of pairs that there are stay below 2^64.
        if is_reported && count >= MOST_PAIRS {
            return Err(Reject::Edit("reported pairs"));
        }
        let reported = is_reported.then_some(count);
        Ok(Self {
            scene: SceneId(header.scene),
            base: header.base,
            revision: header.revision,
            is_acknowledged: header.scene_flags & TAKEN != 0,
            is_lost: header.scene_flags & LOST != 0,
            reported,
            report,
            most_boxes: header.most_boxes,
            engine,
            threads: threads_of(header.threads),
            boxes,
            steps: section(SectionKind::SceneSteps, super::body::STEP_BYTES, "steps")?,
            indices: section(SectionKind::SceneIndices, 4, "indices")?,
        })
    }
}
