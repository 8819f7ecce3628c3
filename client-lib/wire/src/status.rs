//! The daemon's status.

use bytemuck::{Pod, Zeroable};
use pairmask_core::engine::{PairSkips, SkipMeter};
use pairmask_core::scene::SceneSkips;

use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope};
use crate::section::{Section, SectionKind, find};
use crate::status_code::StatusCode;

/// Number of errors that the daemon keeps.
pub const LAST_ERRORS: usize = 8;

/// A request that the daemon answered with an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RecordedError {
    /// Token of the client.
    pub client_token: u64,
    /// The client's number of the frame.
    pub frame: u64,
    /// Nanoseconds after the daemon's start.
    pub at_ns: u64,
    /// A [`StatusCode`].
    pub status: u32,
    /// Zero.
    pub reserved: u32,
}

/// Results of the daemon's auditor, which checks a share of the frames again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct AuditCounts {
    /// One frame in so many is checked; 0 for none.
    pub one_in: u64,
    /// Frames checked, wholly or in part.
    pub frames: u64,
    /// Frames drawn and not checked, since the auditor was still busy.
    pub skipped: u64,
    /// Pairs of boxes that were compared again.
    pub pairs: u64,
    /// Pairs among them that overlap and were not in the mask. Anything but 0 is a bug.
    pub missed: u64,
    /// Pairs among them that were in the mask and do not overlap. Anything but 0 is a bug.
    pub extra: u64,
}

/// Work that a daemon's answers left out, since it began to serve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SkipTotals {
    /// Frames that were equal to their session's last one.
    pub repeats: u64,
    /// Boxes that were not looked at.
    pub boxes: u64,
    /// Pairs that were not tested: of two static boxes.
    pub static_pairs: u64,
    /// Of two boxes that have not moved.
    pub unmoved_pairs: u64,
    /// Of an empty or invalid box.
    pub empty_pairs: u64,
    /// Of boxes in cells too far apart.
    pub cell_pairs: u64,
    /// Of boxes that the order along an axis holds apart.
    pub axis_pairs: u64,
    /// Words of answers that were not sent: zero words of masks, and two words for each pair of a scene
    /// that its client knows already.
    pub words: u64,
}

impl SkipTotals {
    /// What the answer to a whole frame left out.
    pub fn of_frame(meter: &SkipMeter) -> Self {
        let repeats = u64::from(meter.is_repeat());
        let all = Self { repeats, boxes: meter.boxes, words: meter.zero_words, ..Self::default() };
        all.with_pairs(&meter.why)
    }

    /// What the answer to an edit of a scene left out. Of `pair_count` pairs, where that is known, it names
    /// `reported` or their changes.
    pub fn of_scene(meter: &SceneSkips, pair_count: Option<u64>, reported: u64) -> Self {
        let words = pair_count.unwrap_or(0).saturating_sub(reported).saturating_mul(2);
        Self { boxes: meter.boxes, words, ..Self::default() }.with_pairs(&meter.why())
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(self, other: &Self) -> Self {
        let (mut sum, other): ([u64; 8], [u64; 8]) = (bytemuck::cast(self), bytemuck::cast(*other));
        sum.iter_mut().zip(other).for_each(|(sum, more)| *sum = sum.saturating_add(more));
        bytemuck::cast(sum)
    }

    const fn with_pairs(mut self, why: &PairSkips) -> Self {
        (self.static_pairs, self.unmoved_pairs, self.empty_pairs) =
            (why.statics, why.unmoved, why.empty);
        (self.cell_pairs, self.axis_pairs) = (why.cell, why.axis);
        self
    }
}

/// The daemon's status: the payload of a status response.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct StatusBody {
    /// Id of the process that serves.
    pub pid: u32,
    /// Number of clients that are connected.
    pub client_count: u32,
    /// Nanoseconds since the process began to serve.
    pub uptime_ns: u64,
    /// Frames answered with a mask.
    pub frames: u64,
    /// Boxes in those frames.
    pub boxes: u64,
    /// Pairs in those frames.
    pub pairs: u64,
    /// Requests answered with an error.
    pub errors: u64,
    /// The last errors, newest first; unused slots are zero.
    pub last_errors: [RecordedError; LAST_ERRORS],
    /// The auditor's counts.
    pub audit: AuditCounts,
    /// Spheres in those frames (since 1.2; zero before).
    pub spheres: u64,
    /// Scenes that it keeps (since 1.4; zero before).
    pub scenes: u32,
    /// Memory that they take, MiB (since 1.4; zero before).
    pub scene_mib: u32,
}

impl StatusBody {
    /// Checks a response to a status request and reads its body.
    ///
    /// # Errors
    /// [`ReplyError`] where the response is not a valid status.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload: &[u8],
    ) -> Result<Self, ReplyError> {
        Reply::check_envelope(header, asked)?;
        let (len, payload_bytes) = (size_of::<Self>(), payload.len() as u64);
        find(&header.sections, SectionKind::Status, 1, payload_bytes)
            .filter(|section| section.bytes == len as u64)
            .and_then(|section| payload.get(section.offset as usize..)?.get(..len))
            .map(bytemuck::pod_read_unaligned)
            .ok_or(ReplyError::Malformed { field: "status body" })
    }
}

/// The header of an answered status request, its body at the start of the payload.
pub fn response_status(fields: &ReplyFields) -> ResponseHeader {
    let mut header = envelope(fields, StatusCode::Ok);
    let bytes = size_of::<StatusBody>() as u64;
    header.sections[0] = Section::required(SectionKind::Status, 0, bytes);
    header
}

const _: () = assert!(size_of::<AuditCounts>() == 48);
const _: () = assert!(size_of::<StatusBody>() == 48 + LAST_ERRORS * 32 + 64);
