//! A request that waits for its answer, and the shared memory of that answer, lent when its size is
//! known.

use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use pairmask_core::BoxCount;
use pairmask_core::dispatch::{CullAnswer, CullOptions, WorldRange};
use pairmask_core::engine::{ReplyBuffer, ReserveError};
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::objects::Objects;
use pairmask_core::precision::BoxSlice;
use pairmask_core::repeat::KeepTicket;
use pairmask_transport::{
    CheckedRequest, FreeChunks, PortTurn, ResponseLoan, Sender, TransportError,
    assume_response_pages,
};
use pairmask_wire::{
    Page, Reject, ReplyFields, Request, ResponseHeader, SceneSections, SentRules,
    WORLD_RANGE_WORDS, page_count, words_in, words_in_mut, write_world_ranges,
};

use super::reply_memory::ReplyMemory;
use crate::ingest::Incoming;
use crate::locked;

const PAIR_WORDS: u64 = 2;
const WORD_BYTES: u64 = size_of::<u32>() as u64;

#[derive(Debug)]
pub(crate) struct ReplyLender {
    turn: Arc<PortTurn>,
    memory: ReplyMemory,
    /// The port's free chunks, for the thread that gives memory back.
    free: Mutex<Option<FreeChunks>>,
    limit_bytes: u64,
}

impl ReplyLender {
    /// Lends at most `limit_bytes` a reply, of the port of these chunks, which is used in such turns.
    pub(crate) fn new(turn: Arc<PortTurn>, free: Option<FreeChunks>, limit_bytes: u64) -> Self {
        Self { turn, memory: ReplyMemory::default(), free: Mutex::new(free), limit_bytes }
    }

    /// Gives memory back that no session needs. `release` says whether others let go of a range.
    pub(crate) fn tidy(&self, sessions: &[u128], release: impl FnMut(&Range<usize>) -> bool) {
        let free = locked(&self.free);
        if let Some(free) = &*free {
            let has_ended = |session| !sessions.contains(&session);
            self.memory.give_back(free, &self.turn, has_ended, release);
        }
    }
}

/// A request in hand. Dropped without an answer, it leaves its client to its deadline.
pub(crate) struct OpenRequest {
    incoming: Incoming,
    pub(crate) sender: Sender,
    pub(crate) fields: ReplyFields,
    pub(crate) taken_at: Instant,
    scene: SceneSections,
    loan: Option<ResponseLoan>,
    lender: Arc<ReplyLender>,
    /// Where its objects and its answer are to be kept.
    pub(crate) keep: Option<KeepTicket>,
    pub(crate) rules: Option<FrameRules>,
    /// Where the ranges of worlds stand in the reply.
    pub(crate) world_ranges: Option<Span>,
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
    pub(crate) fn new(incoming: Incoming, lender: Arc<ReplyLender>) -> Self {
        let taken_at = Instant::now();
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
            lender,
            keep: None,
            rules: None,
            world_ranges: None,
        }
    }

    pub(crate) fn parse(&self) -> Result<Request, Reject> {
        Request::parse(self.request().header(), self.payload_bytes())
    }

    pub(crate) fn slot_scene(&mut self, scene: SceneSections) -> Result<(), Reject> {
        if scene.objects_in(self.request().pages()).is_none() {
            let payload_bytes = self.payload_bytes();
            return Err(Reject::Objects { box_count: scene.count.get(), payload_bytes });
        }
        self.scene = scene;
        Ok(())
    }

    pub(crate) fn limit_words(&self) -> u64 {
        self.lender.limit_bytes / WORD_BYTES
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
        let Self { incoming, scene, loan, lender, .. } = self;
        (objects_at(&incoming.request, *scene), LoanReply { incoming, loan, lender })
    }

    pub(crate) fn payload_and_reply(&mut self) -> (&[Page], LoanReply<'_>) {
        let Self { incoming, loan, lender, .. } = self;
        (incoming.request.pages(), LoanReply { incoming, loan, lender })
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
        self.loan.as_ref().map_or(&[], |loan| words_in(loan.payload()))
    }

    pub(crate) fn words_mut(&mut self) -> &mut [u32] {
        self.loan.as_mut().map_or(&mut [], |loan| words_in_mut(loan.payload_mut()))
    }

    /// Sends what was written, where somebody waits for it. Where nothing was written, one page goes with the header:
    /// the transport has no empty payload.
    pub(crate) fn send(&mut self, header: &ResponseHeader) -> Result<(), TransportError> {
        if self.loan.is_none() {
            let (_, mut reply) = self.parts();
            reply.reserve(0).map_err(|e| TransportError::new("lending a response", &e))?;
        }
        let Some(mut loan) = self.loan.take() else { return Ok(()) };
        *loan.user_header_mut() = *header;
        let request = self.incoming.request.request();
        let sent = self.lender.turn.take(|| {
            // The place of a disconnected client may be another's by now, whose own answer would find no room beside
            // this one.
            if !request.is_connected() {
                drop(loan);
                return Ok(());
            }
            loan.send()
        });
        sent.map_err(|e| TransportError::new("sending a response", &e))
    }

    pub(crate) fn close(self) {
        let lender = Arc::clone(&self.lender);
        lender.turn.take(|| drop(self));
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
    incoming: &'a Incoming,
    loan: &'a mut Option<ResponseLoan>,
    lender: &'a ReplyLender,
}

impl ReplyBuffer for LoanReply<'_> {
    fn limit_words(&self) -> u64 {
        self.lender.limit_bytes / WORD_BYTES
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let limit_bytes = self.lender.limit_bytes;
        let needed_bytes = words.saturating_mul(WORD_BYTES);
        if needed_bytes > limit_bytes {
            return Err(ReserveError::TooLarge { at_least_bytes: needed_bytes, limit_bytes });
        }
        let out_of_memory = ReserveError::OutOfMemory { needed_bytes };
        let pages = usize::try_from(page_count(needed_bytes)).map_err(|_| out_of_memory)?;
        let loan = self.lender.turn.take(|| {
            // A request has one loan at a time: the old one goes back first.
            *self.loan = None;
            self.incoming.request.request().loan_slice_uninit(pages)
        });
        let mut loan = assume_response_pages(loan.map_err(|_| out_of_memory)?);
        let session = self.incoming.sender.session;
        self.lender.memory.ensure(loan.payload_mut(), session).map_err(|_| out_of_memory)?;
        Ok(words_in_mut(self.loan.insert(loan).payload_mut()))
    }
}
