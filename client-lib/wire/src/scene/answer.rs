//! The answer to an edit: lists of pairs, and a header that says where they lie.

use std::iter::Zip;
use std::slice;

use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::mask::Span;
use pairmask_core::scene::{EndReason, Ended, Reported, SceneSkips};

use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope, stages};
use crate::section::{Section, SectionKind, find, slots};
use crate::status_code::StatusCode;

/// Flag of an answer: the pairs are all there are, in place of changes.
const RESYNC: u32 = 1;
/// Flag of an answer: it says how many pairs there are.
const COUNTED: u32 = 1 << 1;

const PAIR_WORDS: u64 = 2;
/// Sections begin on a cache line, words.
const LINE_WORDS: u64 = 16;

/// The wire's number of a reason.
const fn reason_number(reason: EndReason) -> u8 {
    match reason {
        EndReason::Removed => 1,
        EndReason::Filtered => 2,
        // What a later core adds reads as this: the boxes are no pair any more.
        _ => 3,
    }
}

fn reason_of(number: u8) -> Option<EndReason> {
    [EndReason::Removed, EndReason::Filtered, EndReason::Separated]
        .into_iter()
        .find(|reason| reason_number(*reason) == number)
}

/// Where the lists of an answer lie in its payload, in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneAnswerLayout {
    /// Pairs that began.
    pub begun: Span,
    /// Pairs that ended.
    pub ended: Span,
    /// Why, a byte each.
    pub reasons: Span,
    /// Pairs of now.
    pub pairs: Span,
}

impl SceneAnswerLayout {
    /// The layout of what a scene reports.
    pub fn of(reported: &Reported) -> Self {
        let mut end = 0u64;
        let mut next = |len: u64| {
            let start = end.next_multiple_of(LINE_WORDS);
            end = start + len;
            Span { start, len }
        };
        let ended = reported.ended().len() as u64;
        Self {
            begun: next(PAIR_WORDS * reported.begun().len() as u64),
            ended: next(PAIR_WORDS * ended),
            reasons: next(ended.div_ceil(4)),
            pairs: next(PAIR_WORDS * reported.pairs().len() as u64),
        }
    }

    /// Words of the payload.
    pub const fn words(&self) -> u64 {
        self.pairs.start + self.pairs.len
    }

    /// Writes what the scene reports into at least so many words.
    ///
    /// # Panics
    /// With fewer.
    pub fn write(&self, reported: &Reported, words: &mut [u32]) {
        let range = |span: &Span| span.start as usize..(span.start + span.len) as usize;
        words[range(&self.begun)].copy_from_slice(reported.begun().as_flattened());
        let to = words[range(&self.ended)].as_chunks_mut().0;
        to.iter_mut().zip(reported.ended()).for_each(|(to, ended)| *to = ended.pair);
        words[range(&self.reasons)].fill(0);
        let to = bytemuck::cast_slice_mut::<u32, u8>(&mut words[range(&self.reasons)]);
        to.iter_mut().zip(reported.ended()).for_each(|(to, e)| *to = reason_number(e.reason));
        words[range(&self.pairs)].copy_from_slice(reported.pairs().as_flattened());
    }

    fn sections(&self) -> [Section; 4] {
        let (reasons_at, reasons) = (4 * self.reasons.start, self.ended.len / PAIR_WORDS);
        [
            Section::of_words(SectionKind::BegunPairs, self.begun),
            Section::of_words(SectionKind::EndedPairs, self.ended),
            Section::required(SectionKind::EndReasons, reasons_at, reasons),
            Section::of_words(SectionKind::ListPairs, self.pairs),
        ]
    }
}

/// The header of an answered edit. `scene_bytes` are what the daemon keeps of the scene.
pub fn response_scene(
    fields: &ReplyFields,
    engine: EngineName,
    threads: usize,
    reported: &Reported,
    scene_bytes: u64,
    times: &StageTimes,
) -> ResponseHeader {
    let mut header = envelope(fields, StatusCode::Ok);
    let flag = |on: bool, flag: u32| if on { flag } else { 0 };
    header.flags =
        flag(reported.is_resync(), RESYNC) | flag(reported.pair_count().is_some(), COUNTED);
    header.engine = engine as u32;
    header.threads = u32::try_from(threads).unwrap_or(u32::MAX);
    header.pair_count = reported.pair_count().unwrap_or(0);
    header.skipped[..5].copy_from_slice(&reported.skipped().to_array());
    header.stages_ns = stages(times);
    header.detail[0] = scene_bytes;
    header.sections = slots(SceneAnswerLayout::of(reported).sections());
    header
}

/// The header that answers a request to end a scene.
pub fn response_scene_ended(fields: &ReplyFields) -> ResponseHeader {
    envelope(fields, StatusCode::Ok)
}

/// A validated answer to an edit. Every span lies within the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneReply {
    /// The engine that found it; it may be one that this build does not know.
    pub engine: EngineId,
    /// Threads that it could use.
    pub threads: usize,
    /// Whether the pairs are all there are, in place of changes.
    pub is_resync: bool,
    /// Pairs of the scene, where the answer knows.
    pub pair_count: Option<u64>,
    /// Work left out.
    pub skipped: SceneSkips,
    /// Bytes that the daemon keeps of the scene.
    pub scene_bytes: u64,
    /// Time in the daemon, ns.
    pub total_ns: u64,
    /// Where the lists lie.
    pub layout: SceneAnswerLayout,
}

impl SceneReply {
    /// Checks a copied header against the request's fields and the payload's length.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload_bytes: u64,
    ) -> Result<Self, ReplyError> {
        Reply::check_envelope(header, asked)?;
        let section = |kind, entry_bytes, field| {
            let section = find(&header.sections, kind, entry_bytes, payload_bytes);
            section.ok_or(ReplyError::Malformed { field })
        };
        let pairs = |kind, field| Ok(section(kind, 4 * PAIR_WORDS, field)?.span());
        let ended = pairs(SectionKind::EndedPairs, "ended pairs")?;
        let reasons = section(SectionKind::EndReasons, 1, "reasons")?;
        let reason_words = reasons.span();
        let ends_in_payload = 4 * (reason_words.start + reason_words.len) <= payload_bytes;
        if reasons.bytes != ended.len / PAIR_WORDS || !ends_in_payload {
            return Err(ReplyError::Malformed { field: "reasons" });
        }
        let [boxes, of_statics, unmoved, cells, tested, _] = header.skipped;
        Ok(Self {
            engine: EngineId::from_wire(header.engine),
            threads: header.threads as usize,
            is_resync: header.flags & RESYNC != 0,
            pair_count: (header.flags & COUNTED != 0).then_some(header.pair_count),
            skipped: SceneSkips::from_array([boxes, of_statics, unmoved, cells, tested]),
            scene_bytes: header.detail[0],
            total_ns: header.stages_ns[4],
            layout: SceneAnswerLayout {
                begun: pairs(SectionKind::BegunPairs, "begun pairs")?,
                ended,
                reasons: reason_words,
                pairs: pairs(SectionKind::ListPairs, "pairs")?,
            },
        })
    }
}

impl SceneAnswerLayout {
    /// The pairs of a span of the payload. Another process may have written anything there.
    pub fn pairs_in<'a>(span: &Span, words: &'a [u32]) -> &'a [[u32; 2]] {
        let range = span.start as usize..(span.start + span.len) as usize;
        words.get(range).unwrap_or(&[]).as_chunks().0
    }

    /// Pairs that ended, and why. One whose indices are no pair below `index_end`, or whose reason is
    /// unknown, is passed over.
    pub fn ended_in<'a>(&self, words: &'a [u32], index_end: u32) -> EndedPairs<'a> {
        let pairs = Self::pairs_in(&self.ended, words);
        let range = self.reasons.start as usize..(self.reasons.start + self.reasons.len) as usize;
        let reasons: &[u8] = bytemuck::cast_slice(words.get(range).unwrap_or(&[]));
        EndedPairs { listed: pairs.iter().zip(reasons), index_end }
    }
}

/// Pairs that ended, as another process has written them.
#[derive(Clone, Debug)]
pub struct EndedPairs<'a> {
    listed: Zip<slice::Iter<'a, [u32; 2]>, slice::Iter<'a, u8>>,
    index_end: u32,
}

impl Iterator for EndedPairs<'_> {
    type Item = Ended;

    fn next(&mut self) -> Option<Ended> {
        let Self { listed, index_end } = self;
        listed.find_map(|(pair, reason)| {
            let (pair, reason) = (*pair, reason_of(*reason)?);
            let [a, b] = pair;
            (a < b && b < *index_end).then_some(Ended { pair, reason })
        })
    }
}
