//! A request that waits for its answer, and the shared memory of that answer, lent when its size is
//! known.

use std::sync::Arc;
use std::time::Instant;

use pairmask_core::BoxCount;
use pairmask_core::cancel::Wanted;
use pairmask_core::dispatch::{CullAnswer, CullOptions, WorldRange};
use pairmask_core::engine::{ReplyBuffer, ReserveError};
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::objects::Objects;
use pairmask_core::precision::BoxSlice;
use pairmask_core::repeat::KeepTicket;
use pairmask_transport::{
    Charge, CheckedRequest, Chunk, ClientSlot, Memory, OverBudget, Sender, Share,
};
use pairmask_wire::{
    Page, Reject, ReplyFields, Request, ResponseHeader, SceneSections, SentRules,
    WORLD_RANGE_WORDS, page_count, words_in, words_in_mut, write_world_ranges,
};

use crate::ingest::Incoming;
use crate::recording::{RecordTicket, Recorder};

const PAIR_WORDS: u64 = 2;
const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// The largest part of what a client may take on top that an answer may have, as a divisor: engines keep up to three
/// words for a word of an answer while they find it.
const ANSWER_PART: u64 = 4;

/// A request in hand. Dropped without an answer, it leaves its client to its deadline.
pub(crate) struct OpenRequest {
    incoming: Incoming,
    pub(crate) sender: Sender,
    pub(crate) fields: ReplyFields,
    pub(crate) taken_at: Instant,
    scene: SceneSections,
    loan: Option<Chunk>,
    limit_bytes: u64,
    /// Of any answer.
    most_bytes: u64,
    /// For its payload.
    payload_charge: Option<Charge>,
    /// For what engines keep while they find the answer.
    words_charge: Option<Charge>,
    /// Where its objects and its answer are to be kept.
    pub(crate) keep: Option<KeepTicket>,
    pub(crate) rules: Option<FrameRules>,
    /// Where the ranges of worlds stand in the reply.
    pub(crate) world_ranges: Option<Span>,
    /// Where it is recorded.
    record: Option<RecordTicket>,
}

pub(crate) struct FrameRules {
    pub sent: Arc<SentRules>,
    /// What the client asks for, to cull the frame once more.
    pub options: CullOptions,
    /// Pairs that an engine without rules has found, once the mask has been filtered.
    pub found_pairs: Option<u64>,
    /// Whether the mask is that of the rules.
    pub is_done: bool,
}

impl OpenRequest {
    /// Of a request whose answer may have so many bytes, and no more than its client may take.
    pub(crate) fn new(incoming: Incoming, most_bytes: u64) -> Self {
        let taken_at = Instant::now();
        let wait = taken_at.saturating_duration_since(incoming.received_at);
        let payload_bytes = size_of_val(incoming.request.pages()) as u64;
        incoming.request.counts().note_received(payload_bytes, wait.as_nanos() as u64);
        let limit_bytes = most_bytes.min(incoming.request.share().left() / ANSWER_PART);
        let header = incoming.request.header();
        let fields = ReplyFields {
            client_token: header.client_token,
            frame: header.frame,
            box_count: BoxCount::new(header.box_count),
        };
        Self {
            sender: incoming.sender,
            incoming,
            fields,
            taken_at,
            scene: SceneSections::EMPTY,
            loan: None,
            limit_bytes,
            most_bytes,
            payload_charge: None,
            words_charge: None,
            keep: None,
            rules: None,
            world_ranges: None,
            record: None,
        }
    }

    /// Says whether its client still waits for the answer. Nobody keeps it longer than the work lasts.
    pub(crate) fn asker(&self) -> Arc<dyn Wanted> {
        self.request().wanted()
    }

    pub(crate) fn is_wanted(&self) -> bool {
        self.request().is_wanted()
    }

    pub(crate) fn parse(&self) -> Result<Request, Reject> {
        Request::parse(self.request().header(), self.payload_bytes())
    }

    /// Records what it asks for, and its answer when that is sent.
    pub(crate) fn record(&mut self, recorder: &Arc<Recorder>, request: &Request) {
        self.record = recorder.note(self.request(), request);
    }

    pub(crate) fn slot_scene(&mut self, scene: SceneSections) -> Result<(), Reject> {
        if scene.objects_in(self.request().pages()).is_none() {
            let payload_bytes = self.payload_bytes();
            return Err(Reject::Objects { box_count: scene.count.get(), payload_bytes });
        }
        self.scene = scene;
        Ok(())
    }

    /// The memory of its client.
    pub(crate) fn share(&self) -> &Share {
        self.request().share()
    }

    /// What its client takes, counted.
    pub(crate) fn counts(&self) -> &ClientSlot {
        self.request().counts()
    }

    /// Makes sure that its payload may be read.
    pub(crate) fn charge_payload(&mut self) -> Result<(), OverBudget> {
        self.payload_charge = self.request().charge_payload()?;
        Ok(())
    }

    /// Charges what engines keep beside the answer of a frame, of as much memory as is left now: of so many objects, three
    /// words at the most for each word of all their pairs.
    pub(crate) fn charge_words(&mut self, objects: u32) -> Result<(), OverBudget> {
        let n = u64::from(objects);
        let all = (n * n / 64 + n).saturating_mul(WORD_BYTES);
        self.limit_bytes = self.most_bytes.min(self.share().left() / ANSWER_PART);
        let bytes = (ANSWER_PART - 1) * self.limit_bytes.min(all);
        self.words_charge = Some(self.share().charge(Memory::Own, bytes)?);
        Ok(())
    }

    /// Memory for a copy of what it carries.
    pub(crate) fn charge_copy(&self) -> Result<Charge, OverBudget> {
        self.share().charge(Memory::Own, self.payload_bytes())
    }

    /// The error of an answer of so many bytes that fits a reply, where its client may take no more.
    pub(crate) fn over_budget(&self, answer_bytes: u64) -> Option<OverBudget> {
        let needed = answer_bytes.saturating_mul(ANSWER_PART);
        (answer_bytes <= self.most_bytes).then(|| self.share().over(needed))
    }

    pub(crate) fn limit_words(&self) -> u64 {
        self.limit_bytes / WORD_BYTES
    }

    pub(crate) fn limit_pairs(&self) -> u64 {
        self.limit_words() / PAIR_WORDS
    }

    pub(crate) fn pages(&self) -> &[Page] {
        self.request().pages()
    }

    /// The objects of its scene; none before they were placed.
    pub(crate) fn objects(&self) -> Objects<'_> {
        objects_at(&self.incoming.request, self.scene)
    }

    pub(crate) fn parts(&mut self) -> (Objects<'_>, LoanReply<'_>) {
        let Self { incoming: Incoming { request, .. }, scene, loan, .. } = self;
        let limit_bytes = self.limit_bytes;
        (objects_at(request, *scene), LoanReply { request, loan, limit_bytes })
    }

    pub(crate) fn payload_and_reply(&mut self) -> (&[Page], LoanReply<'_>) {
        let Self { incoming: Incoming { request, .. }, loan, limit_bytes, .. } = self;
        (request.pages(), LoanReply { request, loan, limit_bytes: *limit_bytes })
    }

    /// Keeps objects and answer where that is needed. The reply holds the mask.
    pub(crate) fn keep(&mut self, answer: &CullAnswer) {
        if let Some(ticket) = self.keep.take() {
            let behind = self.world_ranges.map_or(0, |span| span.len);
            ticket.keep(self.objects(), self.words(), answer, behind);
        }
    }

    /// Gives it rules. The mask is that of the rules already, or will be.
    pub(crate) fn put_rules(&mut self, sent: Arc<SentRules>, options: CullOptions, is_done: bool) {
        self.rules = Some(FrameRules { sent, options, found_pairs: None, is_done });
    }

    /// Writes where the pairs of each world stand behind a mask of this shape, for which the reply has room.
    pub(crate) fn put_world_ranges(&mut self, shape: &MaskShape, ranges: &[WorldRange]) {
        let span = world_range_span(shape, (WORLD_RANGE_WORDS * ranges.len()) as u64);
        let end = span.start.saturating_add(span.len);
        let room = self.words_mut().get_mut(span.start as usize..end as usize);
        if let Some(room) = room.filter(|room| !room.is_empty()) {
            write_world_ranges(ranges, room);
            self.world_ranges = Some(span);
        }
    }

    /// Notes that the reply has so many words of ranges of worlds behind a mask of this shape.
    pub(crate) fn note_world_ranges(&mut self, shape: &MaskShape, words: u64) {
        self.world_ranges = (words > 0).then(|| world_range_span(shape, words));
    }

    /// Puts a few bytes that are not a mask.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Result<(), ReserveError> {
        let (_, mut reply) = self.parts();
        let words = reply.reserve((bytes.len() as u64).div_ceil(WORD_BYTES))?;
        bytemuck::cast_slice_mut::<u32, u8>(words)[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    pub(crate) fn words(&self) -> &[u32] {
        self.loan.as_ref().map_or(&[], |loan| words_in(loan.pages()))
    }

    pub(crate) fn words_mut(&mut self) -> &mut [u32] {
        self.loan.as_mut().map_or(&mut [], |loan| words_in_mut(loan.pages_mut()))
    }

    /// Sends what was written, and wakes the client, where it still waits. Where nothing was written, one page goes with the
    /// header; where there is no memory for that, the client's deadline ends its wait.
    pub(crate) fn send(&mut self, header: &ResponseHeader) {
        if self.loan.is_none() {
            let (_, mut reply) = self.parts();
            if let Err(error) = reply.reserve(0) {
                log::debug!("sending a response: {error}");
            }
        }
        if let Some(loan) = self.loan.take() {
            let bytes = size_of_val(loan.pages()) as u64;
            self.counts().note_sent(bytes, self.share().used());
            if let Some(record) = self.record.take() {
                record.answer(&self.fields, header, loan.pages());
            }
            self.request().answer(header, loan);
        }
    }

    /// Number of the segment that its objects lie in.
    pub(crate) fn segment(&self) -> u64 {
        self.request().segment()
    }

    fn request(&self) -> &CheckedRequest {
        &self.incoming.request
    }

    fn payload_bytes(&self) -> u64 {
        size_of_val(self.request().pages()) as u64
    }
}

fn world_range_span(shape: &MaskShape, words: u64) -> Span {
    Span { start: shape.extent_words(), len: words }
}

fn objects_at(request: &CheckedRequest, scene: SceneSections) -> Objects<'_> {
    // They are there: they were when they were placed, and the payload's length is a copy.
    scene.objects_in(request.pages()).unwrap_or(Objects::Boxes(BoxSlice::default()))
}

pub(crate) struct LoanReply<'a> {
    request: &'a CheckedRequest,
    loan: &'a mut Option<Chunk>,
    limit_bytes: u64,
}

impl ReplyBuffer for LoanReply<'_> {
    fn limit_words(&self) -> u64 {
        self.limit_bytes / WORD_BYTES
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let limit_bytes = self.limit_bytes;
        let needed_bytes = words.saturating_mul(WORD_BYTES);
        if needed_bytes > limit_bytes {
            return Err(ReserveError::TooLarge { at_least_bytes: needed_bytes, limit_bytes });
        }
        let out_of_memory = ReserveError::OutOfMemory { needed_bytes };
        let pages = usize::try_from(page_count(needed_bytes)).map_err(|_| out_of_memory)?;
        // The old memory goes back first.
        *self.loan = None;
        let loan = self.request.lend(pages).map_err(|_| match self.request.share().left() {
            left if left < needed_bytes => {
                ReserveError::TooLarge { at_least_bytes: needed_bytes, limit_bytes: left }
            }
            _ => out_of_memory,
        })?;
        Ok(words_in_mut(self.loan.insert(loan).pages_mut()))
    }

    fn asker(&self) -> Option<Arc<dyn Wanted>> {
        Some(self.request.wanted())
    }
}
