//! What threads that serve hand over, and the thread that writes it.
//!
//! Serving waits for a copy of the request and for the digest of the answer, never for the disk. What waits to be written
//! is bounded. A session that sends more is recorded no further, as a whole: a scene without one of its edits is of no use.

use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::Thread;
use std::time::{Duration, Instant};

use pairmask_transport::{Charge, CheckedRequest, Memory};
use pairmask_wire::{Page, ReplyFields, Request, ResponseHeader};

use super::answered::Answered;
use super::block::BLOCK_BYTES;
use super::file::{RecordFile, Written};
use super::record::{Event, MOST_PAYLOAD_BYTES, Record, SessionEnd, copied};
use crate::locked;
use crate::serve::{ServeError, StoppedThread};

/// Bytes that wait to be written. The largest request fits, and as much again. Each client's are charged to it.
const MOST_QUEUED_BYTES: usize = 2 * MOST_PAYLOAD_BYTES;

/// Bytes that a record counts for beside its payload: about what its memory takes.
const RECORD_BYTES: usize = 512;

/// A block is closed after this time, also where it is not full: a process that is killed loses so much at the most.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);

pub(crate) struct Recorder {
    state: Mutex<State>,
    /// Cleared when the file is full or cannot be written.
    is_open: AtomicBool,
    writer: OnceLock<Thread>,
    began_ns: u64,
    began_at: Instant,
    /// Of the file, when `began_at` was.
    first_ns: u64,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Waiting>,
    queued_bytes: usize,
    /// Of requests.
    numbers: u64,
    sessions: HashSet<u64>,
    /// Those that are recorded no further.
    dropped: HashSet<u64>,
}

/// A record that waits to be written.
struct Waiting {
    record: Record,
    /// For the payload of a request.
    _charge: Option<Charge>,
}

/// A request that was recorded, and waits for its answer.
pub(crate) struct RecordTicket {
    recorder: Arc<Recorder>,
    number: u64,
    request: Request,
}

impl Recorder {
    /// Starts the thread that writes, until the second part is dropped.
    pub fn start(file: RecordFile) -> Result<(Arc<Self>, StoppedThread), ServeError> {
        let recorder = Arc::new(Self {
            state: Mutex::default(),
            is_open: AtomicBool::new(true),
            writer: OnceLock::new(),
            began_ns: file.began_ns(),
            began_at: Instant::now(),
            first_ns: file.now_ns(),
        });
        let writes = Arc::clone(&recorder);
        let write = move |stop: &AtomicBool| writes.write_until(stop, file);
        let thread = StoppedThread::start("recorder", "starting the recorder", write)?;
        Ok((recorder, thread))
    }

    /// Notes a request that is about to be served.
    pub fn note(
        self: &Arc<Self>,
        sent: &CheckedRequest,
        request: &Request,
    ) -> Option<RecordTicket> {
        if !self.is_open.load(Ordering::Relaxed) {
            return None;
        }
        let (session, header) = (sent.sender().session, sent.header());
        if locked(&self.state).dropped.contains(&session) {
            return None;
        }
        let payload = copied(header, bytemuck::cast_slice(sent.pages()));
        let bytes = payload.as_ref().map(Vec::len);
        let charge = sent.share().charge(Memory::Own, bytes.unwrap_or(0) as u64).ok();
        let at_ns = self.sent_at(sent.sent_at());
        let mut state = locked(&self.state);
        let (number, payload) = match state.admit(session, payload, charge.is_some()) {
            Ok(admitted) => admitted,
            Err(why) => {
                state.put(at_ns, Event::SessionEnded { session, why }, None);
                drop(state);
                let what = match why {
                    SessionEnd::TooLarge => "a request is too large",
                    _ => "its requests come faster than they are written",
                };
                log::warn!("session {session} is recorded no further: {what}");
                return None;
            }
        };
        let header = Box::new(*header);
        state.put(at_ns, Event::Request { session, number, header, payload }, charge);
        let is_block = state.queued_bytes >= BLOCK_BYTES;
        drop(state);
        if let Some(writer) = self.writer.get().filter(|_| is_block) {
            writer.unpark();
        }
        Some(RecordTicket { recorder: Arc::clone(self), number, request: *request })
    }

    /// Notes which sessions there are: others have ended.
    pub fn note_sessions(&self, connected: &[u64]) {
        let now_ns = self.now_ns();
        let mut state = locked(&self.state);
        let has_ended = |session: &u64| !connected.contains(session);
        let ended: Vec<u64> = state.sessions.extract_if(has_ended).collect();
        for session in ended {
            if !state.dropped.remove(&session) {
                let why = SessionEnd::Disconnected;
                state.put(now_ns, Event::SessionEnded { session, why }, None);
            }
        }
    }

    fn now_ns(&self) -> u64 {
        self.first_ns + self.began_at.elapsed().as_nanos() as u64
    }

    /// When a request was sent, which its client says, or may not: no later than now.
    fn sent_at(&self, since_1970_ns: u64) -> u64 {
        let now_ns = self.now_ns();
        since_1970_ns.checked_sub(self.began_ns).map_or(now_ns, |at_ns| at_ns.min(now_ns))
    }

    fn write_until(&self, stop: &AtomicBool, mut file: RecordFile) {
        // Nothing else sets it.
        let _ = self.writer.set(std::thread::current());
        let mut flushed_at = Instant::now();
        loop {
            let is_last = stop.load(Ordering::Relaxed);
            let mut written = Ok(Written::Done);
            while matches!(written, Ok(Written::Done))
                && let Some(waiting) = self.next()
            {
                written = file.write(&waiting.record);
            }
            let is_due = is_last || flushed_at.elapsed() >= FLUSH_INTERVAL;
            if is_due && matches!(written, Ok(Written::Done)) {
                written = file.flush();
                flushed_at = Instant::now();
            }
            match written {
                Ok(Written::Done) if !is_last => std::thread::park_timeout(FLUSH_INTERVAL / 8),
                Ok(Written::Done) => break,
                Ok(Written::Full) => {
                    log::warn!("the recording is as large as it may be, and ends here");
                    break;
                }
                Err(error) => {
                    log::warn!("the recording ends here: {error}");
                    break;
                }
            }
        }
        self.is_open.store(false, Ordering::Relaxed);
        *locked(&self.state) = State::default();
    }

    fn next(&self) -> Option<Waiting> {
        let mut state = locked(&self.state);
        let waiting = state.queue.pop_front()?;
        state.queued_bytes -= queued_bytes(&waiting.record.event);
        Some(waiting)
    }
}

fn queued_bytes(event: &Event) -> usize {
    match event {
        Event::Request { payload, .. } => RECORD_BYTES + payload.len(),
        _ => RECORD_BYTES,
    }
}

impl State {
    /// The number of a request and its payload, if it is to be recorded. `None` is a payload of more than is recorded.
    /// Its session is recorded no further where it is not.
    fn admit(
        &mut self,
        session: u64,
        payload: Option<Vec<u8>>,
        has_memory: bool,
    ) -> Result<(u64, Vec<u8>), SessionEnd> {
        self.sessions.insert(session);
        let why = match payload {
            None => SessionEnd::TooLarge,
            Some(payload)
                if has_memory && self.queued_bytes + payload.len() <= MOST_QUEUED_BYTES =>
            {
                self.numbers += 1;
                return Ok((self.numbers, payload));
            }
            Some(_) => SessionEnd::TooFast,
        };
        self.dropped.insert(session);
        Err(why)
    }

    fn put(&mut self, at_ns: u64, event: Event, charge: Option<Charge>) {
        self.queued_bytes += queued_bytes(&event);
        self.queue.push_back(Waiting { record: Record { at_ns, event }, _charge: charge });
    }
}

impl RecordTicket {
    /// Notes the answer, before it is sent.
    pub fn answer(self, asked: &ReplyFields, header: &ResponseHeader, pages: &[Page]) {
        let Self { recorder, number, request } = self;
        if !recorder.is_open.load(Ordering::Relaxed) {
            return;
        }
        match Answered::of(&request, asked, (header, pages), |_| ()) {
            Ok(answered) => {
                let at_ns = recorder.now_ns();
                locked(&recorder.state).put(at_ns, Event::Answer { number, answered }, None);
            }
            // The request stays in the recording, without an answer to compare.
            Err(error) => log::warn!("an answer is not recorded: {error}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;
    use pairmask_wire::RequestHeader;

    use super::*;

    fn request(number: u64, payload_bytes: usize) -> Event {
        let header = Box::new(RequestHeader::zeroed());
        Event::Request { session: number, number, header, payload: vec![0; payload_bytes] }
    }

    #[test]
    fn a_session_that_has_no_room_is_recorded_no_further_and_others_are() {
        let mut state = State::default();
        let half = MOST_QUEUED_BYTES / 2 - RECORD_BYTES;
        for number in 1..=2 {
            let admitted = state.admit(number, Some(vec![7; half]), true);
            assert_eq!(admitted, Ok((number, vec![7; half])));
            state.put(0, request(number, half), None);
        }
        assert_eq!(
            state.admit(3, Some(vec![0]), true),
            Err(SessionEnd::TooFast),
            "the queue is full"
        );
        assert_eq!(state.admit(4, None, true), Err(SessionEnd::TooLarge));
        assert_eq!(state.admit(5, Some(vec![]), false), Err(SessionEnd::TooFast), "over its share");
        assert_eq!(state.dropped, HashSet::from([3, 4, 5]));
        assert_eq!(state.admit(6, Some(vec![]), true), Ok((3, vec![])), "numbers have no gaps");
    }

    /// As where the disk is full.
    #[test]
    fn a_file_that_cannot_be_written_ends_the_recording_and_frees_what_waits() {
        let name = tempfile::NamedTempFile::new().expect("a temporary file");
        let file = RecordFile::unwritable(name.path());
        let (recorder, thread) = Recorder::start(file).expect("a thread");
        locked(&recorder.state).put(0, request(1, 10), None);
        while recorder.is_open.load(Ordering::Relaxed) {
            std::thread::yield_now();
        }
        drop(thread);
        let state = locked(&recorder.state);
        assert!(state.queue.is_empty() && state.queued_bytes == 0);
    }
}
