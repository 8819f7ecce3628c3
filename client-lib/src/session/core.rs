//! What the frames of a session share: settings, engines, and the connection, which may be lost and
//! made again.

use std::mem::{Discriminant, discriminant};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_core::units::BoxCount;
use pairmask_wire::{ReplyError, ReplyFields, RequestHeader, RulesLayout, SceneId, StatusBody};

use super::error::{ConnectError, Error, Loss};
use super::link::{self, Answer, Exchange, LeftDaemon, Link, LinkError, SharedFrame, no_daemon};
use super::local::Local;
use super::pairs::ServedBy;
use super::settings::{Backend, Settings};
use super::spares::lock;
use super::unread::{Ending, Unread, UnreadEdits};

/// A missing daemon is looked for this often at most, which costs 10 µs: one that was killed is back after some 40 ms.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);
/// A daemon that is there and takes no connection is tried this often at most: a connection costs 2 ms.
const RECONNECT_INTERVAL: Duration = Duration::from_millis(100);
/// A daemon that lives but did not answer is tried again after this time at the latest. The pause is
/// [`RECONNECT_INTERVAL`] at first and doubles with each time in a row.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// A daemon that does not answer a trial within this time is still silent. No frame waits for it.
const TRIAL_WITHIN: Duration = Duration::from_secs(1);

/// The end of a scene waits this long at most for the daemon.
const END_WITHIN: Duration = Duration::from_millis(20);

#[derive(Debug, Default)]
struct Connection {
    link: Option<Arc<Link>>,
    retry_at: Option<Instant>,
    /// Why there is no connection, until the next attempt.
    cause: Option<ConnectError>,
    silence: Option<Silence>,
    /// How often in a row a daemon did not answer.
    silences: u32,
    /// The kinds of causes for which the log already says that frames are answered in process.
    reported: Vec<Kind>,
}

/// A daemon that did not answer, and is not asked again before it runs.
#[derive(Debug)]
struct Silence {
    daemon: LeftDaemon,
    trial: Option<Trial>,
}

/// A question that a daemon has to answer before it gets frames again. Nobody waits for the answer.
struct Trial {
    link: Arc<Link>,
    exchange: Exchange,
    until: Instant,
}

impl std::fmt::Debug for Trial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Trial").field("until", &self.until).finish_non_exhaustive()
    }
}

/// How a trial stands.
enum Tried {
    Answered,
    UnderWay,
    Failed,
}

impl Trial {
    fn look(&mut self, now: Instant) -> Tried {
        match self.exchange.has_come_by(now) {
            true if self.exchange.is_answered() => Tried::Answered,
            false if now < self.until => Tried::UnderWay,
            _ => Tried::Failed,
        }
    }
}

/// Logs once for a connection that a frame is answered in process, because the daemon's response is an error or
/// malformed.
pub(super) fn say_refused(link: &Link, why: &ReplyError) {
    if link.refuse() {
        log::warn!("a frame is answered in process, and others may be: {why}");
    }
}

/// The pause after a daemon did not answer for so many times in a row.
fn pause_after(silences: u32) -> Duration {
    // A shift of more is far beyond the longest pause.
    (RECONNECT_INTERVAL * (1 << silences.min(16))).min(LONGEST_PAUSE)
}

/// The variants of an error without their fields.
type Kind = (Discriminant<Error>, Option<Discriminant<ConnectError>>);

fn kind_of(error: &Error) -> Kind {
    let connect = match error {
        Error::Connect(error) => Some(discriminant(error)),
        _ => None,
    };
    (discriminant(error), connect)
}

impl Connection {
    fn try_by(&mut self, trial: Trial) {
        if let Some(silence) = &mut self.silence {
            silence.trial = Some(trial);
        }
    }

    /// The daemon did not answer on this connection.
    fn note_silence(&mut self, link: &Link, now: Instant) {
        if link.has_answered() {
            self.silences = 0;
        }
        self.retry_at = Some(now + pause_after(self.silences));
        self.silences += 1;
        self.silence = Some(Silence { daemon: link.left(), trial: None });
    }
}

#[derive(Debug)]
pub(super) struct Core {
    settings: Settings,
    local: Local,
    connection: Mutex<Connection>,
    frames: AtomicU64,
    /// Bytes that frames have room for behind boxes and filter data; 0 before the first frame with rules.
    rules_room: AtomicU64,
    scenes: AtomicU32,
    unread: UnreadEdits,
}

impl Core {
    pub(super) fn new(mut settings: Settings) -> Result<Self, ConnectError> {
        settings.backend = link::backend(settings.backend)?;
        let local = Local::new(settings.clone());
        let core = Self {
            settings,
            local,
            connection: Mutex::default(),
            frames: AtomicU64::new(0),
            rules_room: AtomicU64::new(0),
            scenes: AtomicU32::new(0),
            unread: UnreadEdits::default(),
        };
        match core.settings.backend {
            Backend::Daemon => drop(core.link()?),
            Backend::Auto => drop(core.link()),
            Backend::InProcess => {}
        }
        Ok(core)
    }

    pub(super) const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The engines of this process.
    pub(super) const fn local(&self) -> &Local {
        &self.local
    }

    pub(super) fn next_frame(&self) -> u64 {
        self.frames.fetch_add(1, Ordering::Relaxed)
    }

    /// The number of a new scene.
    pub(super) fn next_scene(&self) -> SceneId {
        SceneId(self.scenes.fetch_add(1, Ordering::Relaxed))
    }

    /// Where a new scene leaves edits whose answers nobody waits for.
    pub(super) fn unread_of_scene(&self) -> Arc<Unread> {
        self.unread.of_new_scene()
    }

    /// Informs the daemon that a scene has ended: now, where a place is free, or else before the session's next
    /// request. Waits a moment for the daemon to be done with the scene: a session that ends right afterwards
    /// leaves nothing under way.
    pub(super) fn end_scene(&self, link: &Arc<Link>, header: &RequestHeader, last: &Arc<Unread>) {
        self.unread.end(Ending::new(link, header), last);
        let deadline = Instant::now() + END_WITHIN;
        // The scene's last edit may hold the last place: the end goes out once that is answered.
        for _ in 0..2 {
            // Without a place the next request reports it.
            let _ = self.unread.report_ended(link, || self.lend_now(link, 0));
            self.unread.wait_for_ended(link, deadline);
        }
    }

    /// Shared memory for `bytes` bytes of a request. Where no place is free, waits for one that is held by
    /// an edit that nobody else waits for. Ended scenes are reported to the daemon before.
    pub(super) fn loan(&self, link: &Arc<Link>, bytes: u64) -> Result<SharedFrame, Error> {
        match self.unread.report_ended(link, || self.position(link, 0)) {
            // Frames hold all places, as those of this request will say unless one was dropped just now.
            Ok(()) | Err(Error::TooManyFrames) => self.position(link, bytes),
            Err(error) => Err(error),
        }
    }

    fn position(&self, link: &Arc<Link>, bytes: u64) -> Result<SharedFrame, Error> {
        loop {
            match self.lend_now(link, bytes) {
                Err(Error::TooManyFrames) => {}
                loaned => return loaned,
            }
            match self.unread.receive_oldest(link, &self.settings) {
                Ok(true) => {}
                // Another thread may have received an answer meanwhile.
                Ok(false) => return Ok(link.loan(bytes)?),
                Err(how) => return Err(self.give_up(link, how).into()),
            }
        }
    }

    /// A place that is free, or held by an edit whose answer has come and that nobody waits for.
    fn lend_now(&self, link: &Arc<Link>, bytes: u64) -> Result<SharedFrame, Error> {
        loop {
            match link.loan(bytes) {
                Err(LinkError::TooManyFrames) if self.unread.receive_landed(link) => {}
                loaned => return Ok(loaned?),
            }
        }
    }

    pub(super) fn may_cull_here(&self) -> bool {
        self.settings.backend != Backend::Daemon
    }

    /// Bytes behind `n` boxes for rules like those of the session's last frame that had any.
    pub(super) fn room_for_rules(&self, n: BoxCount) -> u64 {
        match self.rules_room.load(Ordering::Relaxed) {
            0 => 0,
            beside_filter_data => RulesLayout::filter_data_bytes(n) + beside_filter_data,
        }
    }

    /// Has the frames to come have room for rules like these.
    pub(super) fn note_rules(&self, layout: &RulesLayout) {
        self.rules_room.store(layout.bytes_beside_filter_data(), Ordering::Relaxed);
    }

    pub(super) fn served_by(&self) -> ServedBy {
        match &lock(&self.connection).link {
            Some(link) if link.is_alive() => ServedBy::Daemon,
            _ => ServedBy::InProcess,
        }
    }

    /// The connection. A lost one is made again once its interval has passed, and one to a daemon that did
    /// not answer once that runs again.
    pub(super) fn link(&self) -> Result<Arc<Link>, ConnectError> {
        let mut connection = lock(&self.connection);
        if let Some(link) = &connection.link {
            return Ok(Arc::clone(link));
        }
        let now = Instant::now();
        if connection.silence.as_ref().is_some_and(|silence| silence.daemon.has_ended()) {
            // Another one may serve.
            (connection.silence, connection.silences, connection.retry_at) = (None, 0, None);
        }
        if let Some(mut trial) = connection.silence.as_mut().and_then(|s| s.trial.take()) {
            match trial.look(now) {
                Tried::Answered => return Ok(self.establish(&mut connection, trial.link)),
                Tried::UnderWay => connection.try_by(trial),
                Tried::Failed => connection.note_silence(&trial.link, now),
            }
            return Err(self.cause(&connection));
        }
        let is_silent = |silence: &Silence| !silence.daemon.has_run();
        if connection.retry_at.is_some_and(|at| now < at)
            || connection.silence.as_ref().is_some_and(is_silent)
        {
            return Err(self.cause(&connection));
        }
        connection.retry_at = Some(now + RECONNECT_INTERVAL);
        let link = match link::open(&self.settings) {
            Ok(link) => Arc::new(link),
            Err(error) => {
                if matches!(error, ConnectError::NoDaemon { .. }) {
                    connection.retry_at = Some(now + LOOK_INTERVAL);
                }
                connection.cause = Some(error.clone());
                return Err(error);
            }
        };
        if self.may_cull_here() && connection.silence.is_some() {
            let begun = link.loan(0);
            match begun.map_err(Error::from).and_then(|shared| self.status_exchange(shared)) {
                Ok((exchange, _)) => {
                    connection.try_by(Trial { link, exchange, until: now + TRIAL_WITHIN });
                }
                Err(_) => connection.note_silence(&link, now),
            }
            return Err(self.cause(&connection));
        }
        Ok(self.establish(&mut connection, link))
    }

    /// Why there is no connection.
    fn cause(&self, connection: &Connection) -> ConnectError {
        connection.cause.clone().unwrap_or_else(|| no_daemon(&self.settings))
    }

    fn establish(&self, connection: &mut Connection, link: Arc<Link>) -> Arc<Link> {
        connection.silence = None;
        connection.link = Some(Arc::clone(&link));
        if !std::mem::take(&mut connection.reported).is_empty() {
            log::info!("instance '{}' answers again", self.settings.instance);
        }
        link
    }

    /// Gives a connection up. Frames that are under way on it are answered in process.
    pub(super) fn lose(&self, lost: &Arc<Link>, how: Loss) -> Result<(), Error> {
        let error = Error::from(self.give_up(lost, how));
        if self.may_cull_here() {
            self.say_in_process(&error);
            Ok(())
        } else {
            Err(error)
        }
    }

    /// Gives a connection up, and says why there is none.
    fn give_up(&self, lost: &Arc<Link>, how: Loss) -> ConnectError {
        let cause = match how {
            Loss::Died => no_daemon(&self.settings),
            Loss::Silent => ConnectError::Silent { instance: self.settings.instance.clone() },
        };
        let mut connection = lock(&self.connection);
        if connection.link.as_ref().is_some_and(|link| Arc::ptr_eq(link, lost)) {
            connection.link = None;
            connection.cause = Some(cause.clone());
            match how {
                Loss::Died => connection.retry_at = None,
                Loss::Silent => connection.note_silence(lost, Instant::now()),
            }
        }
        cause
    }

    /// Logs that frames are answered in process, once for each kind of cause until the daemon
    /// answers again.
    pub(super) fn say_in_process(&self, why: &Error) {
        let reported = &mut lock(&self.connection).reported;
        if !reported.contains(&kind_of(why)) {
            reported.push(kind_of(why));
            log::warn!("frames are answered in process: {why}");
        }
    }

    /// Waits for the answer to a request, as long as the session's deadline allows.
    pub(super) fn end(&self, exchange: Exchange, expected: Expected) -> Result<Answer, Error> {
        Ok(exchange.end(expected, self.settings.spin, self.settings.deadline)?)
    }

    /// Asks for the daemon's status.
    fn status_exchange(&self, shared: SharedFrame) -> Result<(Exchange, ReplyFields), Error> {
        let asked = ReplyFields {
            client_token: shared.slot.link().token(),
            frame: self.next_frame(),
            box_count: BoxCount::default(),
        };
        let header = RequestHeader::status(asked.client_token, asked.frame);
        Ok((Exchange::begin(shared, &header)?, asked))
    }

    pub(super) fn daemon_status(&self) -> Result<StatusBody, Error> {
        let link = self.link()?;
        let asked = self.status_exchange(self.loan(&link, 0)?);
        let answered =
            asked.and_then(|(exchange, asked)| Ok((self.end(exchange, link.expect(0))?, asked)));
        if let Err(error) = &answered
            && let Some(how) = Loss::of(error)
        {
            let _ = self.lose(&link, how);
        }
        let (answer, asked) = answered?;
        let payload = bytemuck::cast_slice(answer.memory.pages());
        StatusBody::parse(&answer.header, &asked, payload).map_err(Error::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_up_to_the_longest() {
        let pauses = [0, 1, 2, 3, 6, 7, u32::MAX].map(|n| pause_after(n).as_millis());
        assert_eq!(pauses, [100, 200, 400, 800, 6_400, 10_000, 10_000]);
    }
}
