//! Answers: from a validated request to a response in the client's hands.

mod account;
mod desk;
mod loan_reply;
mod wake;

use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Instant;

use iceoryx2::service::ipc;
use pairmask::dispatch::CullWish;
use pairmask::engine::{CullError, CullReport, ReserveError};
use pairmask::mask::ReadableEncodings;
use pairmask::precision::BoxForm;
use pairmask::transport::{
    Limits, Populated, ResponseLoan, Services, WakeClient, narrow_boxes_in, objects_in,
    words_in_mut,
};
use pairmask::units::BoxCount;
use pairmask::wire::{Objects, PAGE_BYTES, Reject, ReplyFields, Request, StatusBody, StatusCode};

use self::account::Account;
use self::desk::{Desk, Said};
use self::loan_reply::LoanReply;
use self::wake::WakeBoard;
use crate::audit::Auditor;
use crate::execute::{CullUnderWay, Executor, FRAMES_UNDER_WAY, Owner, Started};
use crate::ingest::Incoming;

/// A frame that the executor works on, and where its answer goes.
struct Frame {
    incoming: Incoming,
    loan: Option<ResponseLoan>,
    cull: CullUnderWay,
    fields: ReplyFields,
    form: BoxForm,
    boxes_offset: usize,
    start: Instant,
}

/// What changes the words of a finished answer and their report. A daemon that serves clients has
/// none: tests show with it that the auditor notices a wrong answer.
pub type AlterAnswer = fn(&mut [u32], &mut CullReport);

/// Answers requests: one at a time, but for frames that a GPU takes its time for.
pub struct Publisher {
    // Dropped before the frames under way, whose memory it uses until then.
    executor: Executor,
    /// Oldest first.
    under_way: VecDeque<Frame>,
    desk: Desk,
    services: Rc<Services<ipc::Service>>,
    populated: Populated,
    max_reply_bytes: u64,
}

impl Publisher {
    /// A publisher on these services.
    pub fn new(
        services: Rc<Services<ipc::Service>>,
        wake_clients: WakeClient,
        limits: &Limits,
        executor: Executor,
        auditor: Auditor,
    ) -> Self {
        Self {
            executor,
            under_way: VecDeque::with_capacity(FRAMES_UNDER_WAY),
            desk: Desk {
                wake_board: WakeBoard::new(wake_clients, limits.max_clients),
                account: Account::new(limits.max_clients),
                auditor,
                alter_answers: None,
                threads: 1,
            },
            services,
            populated: Populated::default(),
            max_reply_bytes: limits.max_reply_bytes,
        }
    }

    /// Changes every answer from now on, or none. For tests of the auditor.
    pub fn alter_answers(&mut self, alter: Option<AlterAnswer>) {
        self.desk.alter_answers = alter;
    }

    /// Gives up what belonged to clients that are gone; to be called now and then.
    pub fn tidy(&mut self) {
        self.executor.tidy();
    }

    /// What the daemon has done so far.
    pub fn status(&self) -> StatusBody {
        let clients = self.services.client_count();
        self.desk.account.body(clients, self.desk.auditor.counts())
    }

    /// Whether another request can be taken in.
    pub fn has_room(&self) -> bool {
        self.under_way.len() < FRAMES_UNDER_WAY
    }

    /// Whether a frame is under way: then [`Self::publish_ended`] is to be called soon.
    pub fn is_busy(&self) -> bool {
        !self.under_way.is_empty()
    }

    /// Threads that the engine of the last answer could use.
    pub fn threads(&self) -> usize {
        self.desk.threads
    }

    /// Lets the engines work for a moment.
    pub fn rest(&mut self) {
        self.executor.rest();
    }

    /// Takes in one request, whatever it holds, and answers it now, or leaves it under way.
    pub fn take(&mut self, incoming: Incoming) {
        let start = Instant::now();
        let (sender, request) = (incoming.sender, &incoming.request);
        let header = *request.header();
        let payload_bytes = size_of_val(request.pages()) as u64;
        let fields = ReplyFields {
            client_token: header.client_token,
            frame: header.frame,
            box_count: BoxCount::new(header.box_count),
        };
        let mut reply =
            LoanReply::new(request.request(), &mut self.populated, self.max_reply_bytes);
        let said = match Request::parse(&header, payload_bytes) {
            Ok(Request::Cull {
                box_count,
                form,
                offset,
                engine,
                encoding,
                threads,
                client_minor,
            }) => {
                let last_pairs = self.desk.account.last_pairs(sender.session);
                let readable = ReadableEncodings::at_minor(client_minor);
                let wish = CullWish { engine, encoding, threads, last_pairs, readable };
                let owner = Owner::Client(sender.port);
                match objects_in(request.pages(), offset, form, box_count) {
                    Some(Objects::Boxes(boxes)) => {
                        match self.executor.begin(boxes, owner, &wish, &mut reply) {
                            Ok(Started::UnderWay(cull)) => {
                                let (loan, form) = (reply.into_loan(), boxes.form());
                                self.under_way.push_back(Frame {
                                    incoming,
                                    loan,
                                    cull,
                                    fields,
                                    form,
                                    boxes_offset: offset,
                                    start,
                                });
                                return;
                            }
                            Ok(Started::Answered(answer)) => {
                                Ok(Said::Answer(Objects::Boxes(boxes), answer))
                            }
                            Err(error) => Err(error.into()),
                        }
                    }
                    Some(objects @ Objects::Spheres(spheres)) => self
                        .executor
                        .cull_spheres(spheres, &wish, &mut reply)
                        .map(|answer| Said::Answer(objects, answer))
                        .map_err(Failure::from),
                    None => Err(refused(box_count, payload_bytes)),
                }
            }
            Ok(Request::Status) => {
                let clients = self.services.client_count();
                let body = self.desk.account.body(clients, self.desk.auditor.counts());
                reply
                    .put(bytemuck::bytes_of(&body))
                    .map(|()| Said::Status)
                    .map_err(|e| Failure::from(CullError::from(e)))
            }
            Err(reject) => Err(reject.into()),
        };
        self.desk.publish(sender, &fields, reply, said, start);
    }

    /// Publishes the oldest frame under way if it has ended. Whether it had.
    pub fn publish_ended(&mut self) -> bool {
        if !self.under_way.front().is_some_and(|frame| self.executor.has_ended(&frame.cull)) {
            return false;
        }
        let Some(frame) = self.under_way.pop_front() else { return false };
        let Frame { incoming, loan, cull, fields, form, boxes_offset, start } = frame;
        let Incoming { sender, request } = &incoming;
        let mut reply =
            LoanReply::new(request.request(), &mut self.populated, self.max_reply_bytes)
                .with_loan(loan);
        let payload_bytes = size_of_val(request.pages()) as u64;
        let ended = narrow_boxes_in(request.pages(), boxes_offset, form, fields.box_count)
            .ok_or_else(|| refused(fields.box_count, payload_bytes))
            .and_then(|boxes| Ok((boxes, self.executor.end(cull, boxes, &mut reply)?)));
        let said = ended.map(|(boxes, answer)| Said::Answer(Objects::Boxes(boxes), answer));
        self.desk.publish(*sender, &fields, reply, said, start);
        true
    }
}

/// The failure of a request whose objects are not all in its payload.
fn refused(box_count: BoxCount, payload_bytes: u64) -> Failure {
    Reject::Objects { box_count: box_count.get(), payload_bytes }.into()
}

/// A request that gets an error for an answer.
struct Failure {
    status: StatusCode,
    detail: [u64; 2],
    text: String,
}

impl From<Reject> for Failure {
    fn from(reject: Reject) -> Self {
        Self { status: reject.status(), detail: [0; 2], text: reject.to_string() }
    }
}

impl From<CullError> for Failure {
    fn from(error: CullError) -> Self {
        let (status, detail) = match error {
            CullError::Reserve(ReserveError::TooLarge { at_least_bytes, limit_bytes }) => {
                (StatusCode::ReplyTooLarge, [at_least_bytes, limit_bytes])
            }
            CullError::Reserve(ReserveError::OutOfMemory { needed_bytes }) => {
                (StatusCode::OutOfMemory, [needed_bytes, 0])
            }
            CullError::Unavailable { engine, .. } => {
                (StatusCode::EngineUnavailable, [engine as u64, 0])
            }
            CullError::TooManyBoxes { n, limit, .. } => (StatusCode::TooManyBoxes, [n, limit]),
            CullError::DeviceLost { engine }
            | CullError::DeviceMemory { engine, .. }
            | CullError::TooCrowded { engine } => (StatusCode::EngineFailed, [engine as u64, 0]),
        };
        Self { status, detail, text: error.to_string() }
    }
}

const _: () = assert!(size_of::<StatusBody>() <= PAGE_BYTES, "a status fits one page");

/// Copies `bytes` to the start of `words`.
fn copy_bytes(words: &mut [u32], bytes: &[u8]) {
    bytemuck::cast_slice_mut::<u32, u8>(words)[..bytes.len()].copy_from_slice(bytes);
}

/// The words of a response's memory.
fn response_words(loan: &mut pairmask::transport::ResponseLoan) -> &mut [u32] {
    words_in_mut(loan.payload_mut())
}
