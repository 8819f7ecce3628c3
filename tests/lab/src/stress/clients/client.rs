//! One client: a process that sends frames of hard scenes and checks the answers until it is asked to end.

use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask::{Error, PairMask, Pending, Scene, SceneEdit, ServedBy, Session, SessionBuilder};
use pairmaskd::scene::Random;
use serde::{Deserialize, Serialize};

use super::offer::{MOST_UNDER_WAY, Offer, Way, pick};
use super::scene_client::{Received, SceneClient};
use crate::processes::report;
use crate::stress::modes::Sending;
use crate::stress::{Answer, Case, Finding, Form, Requested};

/// A frame without an answer for this long is lost. Software GPUs and all pairs of a large scene take
/// a second on a machine that has less cores than clients.
pub(super) const DEADLINE: Duration = Duration::from_secs(30);
const RETRY_INTERVAL: Duration = Duration::from_millis(20);
pub(super) const MOST_SESSIONS: u64 = 3;
/// Scenes that a client draws frames from, several times: a truth takes longer than an answer.
const STOCK: usize = 5;
/// One scene in so many is a large one.
const LARGE_ONE_IN: u64 = 10;
/// One edit in so many begins a scene anew.
const NEW_SCENE_ONE_IN: u64 = 60;
/// One compared edit in so many is followed by queries, by at most so many boxes.
const QUERY_ONE_IN: u64 = 4;
const MOST_QUERIES: usize = 50;
const REPORT_INTERVAL: Duration = Duration::from_millis(200);
/// Lost or wrong frames after which a client ends: more of them say nothing new.
const MOST_FAILURES: u32 = 10;
/// Longest pause: frames of a game at 60 Hz are this far apart.
const LONGEST_PAUSE_US: u64 = 17_000;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ClientSettings {
    pub seed: u64,
    /// A case that every second frame is of.
    pub case: Option<u64>,
    pub requested: Requested,
    pub with_gpu: bool,
    /// Whether clients are killed now and then, and close sessions with frames under way.
    pub is_abrupt: bool,
    /// The pace of clients that leave most of a core alone; `None` for requests one after the other.
    pub pace: Option<Pace>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pace {
    /// Sessions at a time of every client: what a daemon takes varies with their number.
    pub sessions: u64,
    /// Mean pause between two steps.
    pub pause: Duration,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Said {
    /// Scenes that it drew and answers that it compared, and the rest.
    Counted([u64; 2], Counts),
    Failed(Box<FailedFrame>),
    /// Its last words: why it could not go on, or nothing where it was asked to end.
    Ended(Option<String>),
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    pub sessions: u64,
    pub frames: u64,
    pub edits: u64,
    pub queries: u64,
    pub unread: u64,
    pub in_process: u64,
    pub unanswered: u64,
}

impl Counts {
    pub(super) const fn add(&mut self, other: &Self) {
        self.sessions += other.sessions;
        self.frames += other.frames;
        self.edits += other.edits;
        self.queries += other.queries;
        self.unread += other.unread;
        self.in_process += other.in_process;
        self.unanswered += other.unanswered;
    }
}

/// A frame or an edit that did not get its pairs from the daemon.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct FailedFrame {
    pub(super) seed: u64,
    pub(super) is_large: bool,
    pub(super) form: Form,
    pub(super) way: String,
    pub(super) finding: Finding,
}

struct UnderWay {
    pending: Pending<PairMask>,
    case: Rc<Case>,
    form: Form,
}

struct Open {
    session: Session,
    way: Way,
    frames: VecDeque<UnderWay>,
    /// Its persistent scene, once there is one, and what has to come of it.
    kept: Option<(Scene, SceneClient)>,
}

struct Client<'a> {
    settings: &'a ClientSettings,
    offer: Offer,
    daemon: SessionBuilder,
    is_over: &'a AtomicBool,
    random: Random,
    kept: Vec<Rc<Case>>,
    stock: Vec<Rc<Case>>,
    sessions: Vec<Open>,
    failures: u32,
    gave_up: Option<String>,
    cases: u64,
    answers: u64,
    counts: Counts,
    reported_at: Instant,
}

impl ClientSettings {
    pub(crate) fn run(&self, daemon: &SessionBuilder, is_over: &AtomicBool) {
        let both =
            |seed: &u64| [false, true].map(|is_large| Rc::new(Case::of_size(*seed, is_large)));
        let mut client = Client {
            settings: self,
            offer: Offer::new(&self.requested, self.with_gpu),
            daemon: daemon.clone().deadline(DEADLINE),
            is_over,
            random: Random::new(self.seed),
            kept: self.case.iter().flat_map(both).collect(),
            stock: Vec::new(),
            sessions: Vec::new(),
            failures: 0,
            gave_up: None,
            cases: 0,
            answers: 0,
            counts: Counts::default(),
            reported_at: Instant::now(),
        };
        client.work();
        client.report();
        report(&Said::Ended(client.gave_up));
    }
}

impl Client<'_> {
    fn work(&mut self) {
        self.cases += self.kept.len() as u64;
        let pace = self.settings.pace;
        let drawn = |random: &mut Random| 1 + random.below(MOST_SESSIONS);
        let sessions = pace.map_or_else(|| drawn(&mut self.random), |pace| pace.sessions);
        for _ in 0..sessions {
            if !self.open() {
                return;
            }
        }
        self.stock = (0..STOCK).map(|_| self.next_case()).collect();
        while !self.is_over.load(Ordering::Relaxed) && self.failures < MOST_FAILURES {
            if let Some(Pace { pause, .. }) = pace {
                std::thread::sleep(pause.mul_f32(2.0 * self.random.unit()));
            }
            let session = self.below(self.sessions.len());
            if !self.step(session) {
                break;
            }
            if self.reported_at.elapsed() >= REPORT_INTERVAL {
                self.report();
            }
        }
        (0..self.sessions.len()).for_each(|session| self.read_all(session));
    }

    fn below(&mut self, bound: usize) -> usize {
        self.random.below(bound as u64) as usize
    }

    /// One step of a session, which sends only with room. Says whether there can be another one.
    fn step(&mut self, session: usize) -> bool {
        let under_way = self.sessions[session].frames.len();
        let has_room = under_way < self.sessions[session].way.depth;
        match self.random.below(200) {
            0..=5 => {
                let pause = Duration::from_micros(self.random.below(LONGEST_PAUSE_US));
                std::thread::sleep(pause);
            }
            6..=9 => {
                let slot = self.below(STOCK);
                self.stock[slot] = self.next_case();
            }
            10 => {
                if !self.settings.is_abrupt {
                    self.read_all(session);
                }
                self.counts.unread += self.sessions[session].frames.len() as u64;
                // Closed first: a client has no more sessions at a time than it may.
                drop(self.sessions.swap_remove(session));
                return self.open();
            }
            11..=20 if under_way > 0 => {
                let frame = self.below(under_way);
                drop(self.sessions[session].frames.remove(frame));
                self.counts.unread += 1;
            }
            21..=110 if has_room => self.send(session),
            _ if under_way > 0 => {
                let frame = self.below(under_way);
                self.read(session, frame);
            }
            _ => self.send(session),
        }
        true
    }

    fn report(&mut self) {
        self.reported_at = Instant::now();
        let new = [&mut self.cases, &mut self.answers].map(std::mem::take);
        report(&Said::Counted(new, std::mem::take(&mut self.counts)));
    }

    /// Reads all answers, and that to one frame more: then the daemon has received what was dropped, too.
    fn read_all(&mut self, session: usize) {
        while !self.sessions[session].frames.is_empty() && self.failures < MOST_FAILURES {
            self.read(session, 0);
        }
        if self.failures < MOST_FAILURES {
            self.send(session);
            self.read(session, 0);
        }
    }

    fn next_case(&mut self) -> Rc<Case> {
        self.cases += 1;
        let seed = Case::next_seed(&mut self.random);
        Rc::new(Case::of_size(seed, self.random.below(LARGE_ONE_IN) == 0))
    }

    /// Opens a session through which the daemon answers; `false` where there is none before it is too late.
    fn open(&mut self) -> bool {
        let way = self.offer.draw(&mut self.random);
        let began = Instant::now();
        loop {
            let why = match way.apply(self.daemon.clone()).connect() {
                Ok(session) if session.served_by() == ServedBy::Daemon => {
                    self.counts.sessions += 1;
                    self.sessions.push(Open { session, way, frames: VecDeque::new(), kept: None });
                    return true;
                }
                Ok(_) => "the daemon takes no session".to_owned(),
                Err(error) => error.to_string(),
            };
            if self.is_over.load(Ordering::Relaxed) {
                return false;
            }
            if began.elapsed() >= DEADLINE {
                self.gave_up = Some(why);
                return false;
            }
            std::thread::sleep(RETRY_INTERVAL);
        }
    }

    fn send(&mut self, session: usize) {
        let is_kept = !self.kept.is_empty() && self.random.below(2) == 0;
        let cases = if is_kept { &self.kept } else { &self.stock };
        let case = Rc::clone(pick(cases, &mut self.random));
        let form = self.sessions[session].way.next(&mut self.random);
        if form == Form::Scene {
            return self.edit(session, &case);
        }
        self.counts.frames += 1;
        let open = &mut self.sessions[session];
        match send(&mut open.session, &case, form) {
            Ok(pending) => open.frames.push_back(UnderWay { pending, case, form }),
            Err(error) => self.fail(session, &case, form, Finding::other(&error)),
        }
    }

    /// Edits the session's scene towards the boxes of a case. One in a few begins anew.
    fn edit(&mut self, session: usize, case: &Case) {
        // The edit needs a place of the session's.
        while self.sessions[session].frames.len() >= MOST_UNDER_WAY {
            self.read(session, 0);
        }
        let random = &mut self.random;
        let Open { session: of, kept, .. } = &mut self.sessions[session];
        if random.below(NEW_SCENE_ONE_IN) == 0 {
            *kept = None;
        }
        let (scene, model) = kept.get_or_insert_with(|| {
            let model = SceneClient::new(random);
            (of.scene(model.options()).expect("no other process is needed"), model)
        });
        self.counts.edits += 1;
        let mut by = ServedBy::Daemon;
        let edited = model.edit(case, random, |steps, report, is_read| {
            case.flags.caller.run(|| {
                let edit = steps.iter().copied().fold(scene.edit(), SceneEdit::step);
                let pending = edit.submit(report)?;
                if !is_read {
                    return Ok(None);
                }
                let answer = pending.wait()?;
                by = answer.served_by();
                Ok(Some(Received {
                    begun: answer.begun().to_vec(),
                    ended: answer.ended().map(|ended| ended.pair).collect(),
                    pairs: answer.pairs().to_vec(),
                    is_resync: answer.is_resync(),
                }))
            })
        });
        let found = match edited {
            Ok(Ok(false)) => {
                self.counts.unread += 1;
                return;
            }
            Ok(compared) => self.answered(by, compared.map(drop)),
            Err(error) => self.unanswered(&error),
        };
        let found = found.and_then(|()| self.query(session, case));
        if let Err(finding) = found {
            self.sessions[session].kept = None;
            self.fail(session, case, Form::Scene, finding);
        }
    }

    /// Queries the session's scene, once in a few calls, by boxes of a case.
    fn query(&mut self, session: usize, case: &Case) -> Result<(), Finding> {
        let boxes = &case.boxes[..case.boxes.len().min(MOST_QUERIES)];
        let Some((scene, model)) = &mut self.sessions[session].kept else { return Ok(()) };
        // A scene without boxes is answered in this process, and rightly so.
        let is_nothing = boxes.is_empty() || scene.is_empty();
        if is_nothing || self.random.below(QUERY_ONE_IN) > 0 {
            return Ok(());
        }
        self.counts.queries += 1;
        match case.flags.caller.run(|| scene.query(boxes)) {
            Ok(answer) => {
                let compared = model.check_query(boxes, answer.to_vec());
                self.answered(answer.served_by(), compared)
            }
            Err(error) => self.unanswered(&error),
        }
    }

    fn read(&mut self, session: usize, frame: usize) {
        let frames = &mut self.sessions[session].frames;
        let Some(UnderWay { pending, case, form }) = frames.remove(frame) else { return };
        let answer = case.flags.caller.run(|| {
            let mask = pending.wait()?;
            let (pairs, count, info) = (mask.to_vec(), mask.count(), mask.info());
            Ok::<_, Error>((Answer { pairs, count, census: info.census }, info.served_by))
        });
        let found = match answer {
            Ok((mut answer, by)) => {
                answer.pairs.sort_unstable();
                self.answered(by, case.check(form, &answer))
            }
            Err(error) => self.unanswered(&error),
        };
        if let Err(finding) = found {
            self.fail(session, &case, form, finding);
        }
    }

    fn unanswered(&mut self, error: &Error) -> Result<(), Finding> {
        self.counts.unanswered += u64::from(matches!(error, Error::Timeout { .. }));
        Err(Finding::other(error))
    }

    /// Counts an answer. One of the client's own process is a mistake, even where it is right.
    fn answered(&mut self, by: ServedBy, compared: Result<(), Finding>) -> Result<(), Finding> {
        let is_own = by != ServedBy::Daemon;
        self.answers += 1;
        self.counts.in_process += u64::from(is_own);
        compared?;
        if is_own {
            return Err(Finding::other(&"the client answered it itself, the daemon did not"));
        }
        Ok(())
    }

    fn fail(&mut self, session: usize, case: &Case, form: Form, finding: Finding) {
        self.failures += 1;
        let way = self.sessions[session].way.to_string();
        let Case { seed, is_large, .. } = *case;
        report(&Said::Failed(Box::new(FailedFrame { seed, is_large, form, way, finding })));
    }
}

/// Writes and sends a frame, as it is read: on a thread with the floating-point flags of the case's caller.
fn send(session: &mut Session, case: &Case, form: Form) -> Result<Pending<PairMask>, Error> {
    // Its truth is computed with the default flags, if it is not there yet.
    case.allowed(form);
    case.flags.caller.run(|| match form {
        Form::Spheres => {
            let spheres = &case.spheres().spheres;
            let mut frame = session.sphere_frame(spheres.len())?;
            frame.spheres_mut().copy_from_slice(spheres);
            frame.submit()
        }
        Form::Mode(usage) if let Sending::Narrow(precision) = &case.in_mode(usage).sending => {
            let given = &case.in_mode(usage).given;
            let mut frame = session.narrow_frame(given.len(), *precision)?;
            frame.write(&given[..])?;
            frame.submit()
        }
        _ => {
            let boxes = match form {
                Form::Mode(usage) => &case.in_mode(usage).sent,
                _ => &case.boxes,
            };
            let mut frame = session.frame(boxes.len())?;
            frame.write(&boxes[..])?;
            frame.submit()
        }
    })
}
