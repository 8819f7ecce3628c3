//! Responses of the daemon.

use bytemuck::{Pod, Zeroable};
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{
    Census, CullReport, EngineId, EngineName, NAMED_INVALID, PairSkips, SkipMeter,
};
use pairmask_core::mask::Encoding;
use pairmask_core::units::BoxCount;

use crate::mask::{mask_sections, mask_shape};
use crate::section::{SECTION_COUNT, Section, find_unknown};
use crate::status_code::StatusCode;
use crate::{RESPONSE_MAGIC, VERSION_MAJOR, VERSION_MINOR};

/// Header of a response, 432 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ResponseHeader {
    /// [`RESPONSE_MAGIC`].
    pub magic: u32,
    /// [`VERSION_MAJOR`].
    pub version_major: u16,
    /// [`VERSION_MINOR`].
    pub version_minor: u16,
    /// A [`StatusCode`].
    pub status: u32,
    /// No flag is defined yet.
    pub flags: u32,
    /// Echo of the request.
    pub client_token: u64,
    /// Echo of the request.
    pub frame: u64,
    /// Echo of the request.
    pub box_count: u32,
    /// The [`EngineName`] that answered, or the number of a later one.
    pub engine: u32,
    /// The [`Encoding`] of the mask.
    pub encoding: u32,
    /// Boxes with a NaN.
    pub invalid: u32,
    /// Boxes with `min > max`.
    pub empty: u32,
    /// Threads that the engine could use.
    pub threads: u32,
    /// Lowest indices of invalid boxes.
    pub first_invalid: [u32; NAMED_INVALID],
    /// Pairs in the mask.
    pub pair_count: u64,
    /// `SkipMeter`: boxes, pairs, zero words; of the pairs those that are unmoved, empty, apart on an axis
    /// (since 1.4; zero before).
    pub skipped: [u64; 6],
    /// `StageTimes`: ingest, plan, execute, publish, total; the rest zero.
    pub stages_ns: [u64; 8],
    /// Numbers of an error, by status; else zero.
    pub detail: [u64; 4],
    /// What lies where in the payload.
    pub sections: [Section; SECTION_COUNT],
}

const _: () = assert!(size_of::<ResponseHeader>() == 432 && align_of::<ResponseHeader>() == 8);

impl Default for ResponseHeader {
    /// All zero, as the transport writes it before the daemon fills it in. Not a valid response.
    fn default() -> Self {
        Self::zeroed()
    }
}

/// Fields of the request that every response echoes, regardless of its status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyFields {
    /// Client named in the request.
    pub client_token: u64,
    /// Frame named in the request.
    pub frame: u64,
    /// Boxes in the request.
    pub box_count: BoxCount,
}

/// A header with the echoed fields and the status, else zero.
pub(crate) fn envelope(fields: &ReplyFields, status: StatusCode) -> ResponseHeader {
    ResponseHeader {
        magic: RESPONSE_MAGIC,
        version_major: VERSION_MAJOR,
        version_minor: VERSION_MINOR,
        status: status as u32,
        client_token: fields.client_token,
        frame: fields.frame,
        box_count: fields.box_count.get(),
        ..ResponseHeader::zeroed()
    }
}

/// The header of an answered cull.
pub fn response_ok(
    fields: &ReplyFields,
    engine: EngineName,
    threads: usize,
    report: &CullReport,
    times: &StageTimes,
) -> ResponseHeader {
    let mut header = ResponseHeader {
        engine: engine as u32,
        encoding: report.shape.encoding() as u32,
        invalid: report.census.invalid,
        empty: report.census.empty,
        threads: u32::try_from(threads).unwrap_or(u32::MAX),
        first_invalid: report.census.first_invalid,
        pair_count: report.pair_count,
        ..envelope(fields, StatusCode::Ok)
    };
    let skipped = &report.skipped;
    let PairSkips { unmoved, empty, axis, .. } = skipped.why;
    header.skipped = [skipped.boxes, skipped.pairs, skipped.zero_words, unmoved, empty, axis];
    header.stages_ns = stages(times);
    header.sections = mask_sections(&report.shape);
    header
}

pub(crate) fn stages(times: &StageTimes) -> [u64; 8] {
    let StageTimes { ingest_ns, plan_ns, execute_ns, publish_ns, total_ns } = *times;
    [ingest_ns, plan_ns, execute_ns, publish_ns, total_ns, 0, 0, 0]
}

/// The times of a header.
pub(crate) const fn times_of(header: &ResponseHeader) -> StageTimes {
    let [ingest_ns, plan_ns, execute_ns, publish_ns, total_ns, ..] = header.stages_ns;
    StageTimes { ingest_ns, plan_ns, execute_ns, publish_ns, total_ns }
}

/// The header of a refused or failed request. The status defines `detail`.
pub fn response_error(
    fields: &ReplyFields,
    status: StatusCode,
    detail: [u64; 2],
) -> ResponseHeader {
    let mut header = envelope(fields, status);
    header.detail[..2].copy_from_slice(&detail);
    header
}

/// A validated response to a cull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Boxes that were culled.
    pub box_count: BoxCount,
    /// Engine that answered; it may be one that this build does not know.
    pub engine: EngineId,
    /// Threads that the engine could use.
    pub threads: usize,
    /// Shape, census, counts. Every span of the shape lies within the payload and has the length
    /// that the encoding and the box count ask for.
    pub report: CullReport,
    /// Time by stage.
    pub times: StageTimes,
}

/// Why a response is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplyError {
    /// Not a pairmask response of this major version.
    #[error("the response is not of wire version {VERSION_MAJOR}")]
    Envelope,
    /// The response answers another request.
    #[error("the response answers frame {found}, not {expected}")]
    Frame {
        /// Frame of the request.
        expected: u64,
        /// Frame of the response.
        found: u64,
    },
    /// The response is for another client: the transport gives the place of one that has died to the next, and with it
    /// an answer that was under way.
    #[error("the response is for another client")]
    Client,
    /// The daemon reports an error.
    #[error("the daemon answered '{}'{}", status.as_str(), status.explain(*detail))]
    Status {
        /// Its code.
        status: StatusCode,
        /// Its numbers.
        detail: [u64; 2],
    },
    /// A status of a later version.
    #[error(
        "the daemon answered with status {found}, which this client does not know: install a newer pairmask"
    )]
    UnknownStatus {
        /// Its number.
        found: u32,
    },
    /// An encoding of a later version.
    #[error(
        "the mask has encoding {found}, which this client does not know: install a newer pairmask"
    )]
    UnknownEncoding {
        /// Its number.
        found: u32,
    },
    /// A required section of a later version.
    #[error(
        "the response requires section {found}, which this client does not know: install a newer pairmask"
    )]
    UnknownSection {
        /// Its kind.
        found: u32,
    },
    /// An impossible number, or a section that is missing, doubled, too short or outside of the
    /// payload.
    #[error("the response's {field} is malformed")]
    Malformed {
        /// The field.
        field: &'static str,
    },
}

impl Reply {
    /// Checks a copied header against the request's fields and the payload's length.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload_bytes: u64,
    ) -> Result<Self, ReplyError> {
        Self::check_envelope(header, asked)?;
        if header.box_count != asked.box_count.get() {
            return Err(ReplyError::Malformed { field: "box count" });
        }
        let unknown = ReplyError::UnknownEncoding { found: header.encoding };
        let encoding = Encoding::from_wire(header.encoding).ok_or(unknown)?;
        let shape = mask_shape(encoding, &header.sections, asked.box_count, payload_bytes)
            .map_err(|field| ReplyError::Malformed { field })?;
        let [boxes, pairs, zero_words, unmoved, empty, axis] = header.skipped;
        let why = PairSkips::of_frame(unmoved, empty, axis).with_cells_of(pairs);
        let times = times_of(header);
        let StageTimes { ingest_ns, execute_ns, publish_ns, .. } = times;
        Ok(Self {
            box_count: asked.box_count,
            engine: EngineId::from_wire(header.engine),
            threads: header.threads as usize,
            report: CullReport {
                shape,
                census: Census {
                    invalid: header.invalid,
                    empty: header.empty,
                    first_invalid: header.first_invalid,
                },
                pair_count: header.pair_count,
                skipped: SkipMeter { boxes, pairs, why, zero_words },
                times: pairmask_core::engine::EngineTimes { ingest_ns, execute_ns, publish_ns },
            },
            times,
        })
    }

    /// Checks magic, version and echoed fields of a response, and that its status is ok.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn check_envelope(header: &ResponseHeader, asked: &ReplyFields) -> Result<(), ReplyError> {
        if header.magic != RESPONSE_MAGIC || header.version_major != VERSION_MAJOR {
            return Err(ReplyError::Envelope);
        }
        if header.client_token != asked.client_token {
            return Err(ReplyError::Client);
        }
        if header.frame != asked.frame {
            return Err(ReplyError::Frame { expected: asked.frame, found: header.frame });
        }
        match StatusCode::from_wire(header.status) {
            Some(StatusCode::Ok) => match find_unknown(&header.sections) {
                None => Ok(()),
                Some(found) => Err(ReplyError::UnknownSection { found }),
            },
            Some(status) => {
                Err(ReplyError::Status { status, detail: [header.detail[0], header.detail[1]] })
            }
            None => Err(ReplyError::UnknownStatus { found: header.status }),
        }
    }
}
