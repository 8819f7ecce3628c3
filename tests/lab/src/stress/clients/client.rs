//! One client: a process with a few sessions, which sends frames of hard scenes and checks the answers
//! until it is told to end.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask::{CommitError, PendingFrame, ServedBy, Session, SessionBuilder, WaitError};
use pairmaskd::scene::Random;

use super::frame::{self, CaseId};
use super::kept_scene::{EditFailure, Edited, KeptScene};
use super::offer::{Asked, Form, MOST_UNDER_WAY, Offer, Way, pick};
use super::protocol::{Counts, Ended, FailedFrame, Said};
use super::steps::{Load, Step, Steps};
use crate::stress::case::Case;
use crate::stress::modes::ModeChoice;
use crate::stress::roster::Entrant;
use crate::stress::subject::Finding;

/// A frame without an answer for this long is lost. Software GPUs and all pairs of a large scene take
/// a second on a machine that has less cores than clients.
pub(super) const DEADLINE: Duration = Duration::from_secs(30);
/// Time between two attempts to open a session.
const RETRY_INTERVAL: Duration = Duration::from_millis(20);
/// Most sessions of a client.
pub(super) const MOST_SESSIONS: u64 = 3;
/// Scenes that a client draws frames from: each is sent several times, because its truth takes longer
/// than the daemon's answer.
const STOCK: usize = 5;
/// One scene in so many is a large one.
const LARGE_ONE_IN: u64 = 10;
/// One edit in so many begins a scene anew.
const NEW_SCENE_ONE_IN: u64 = 60;
/// How often a client tells its counts.
const TELL_INTERVAL: Duration = Duration::from_millis(200);
/// Lost or wrong frames after which a client ends: more of them say nothing new.
const MOST_FAILURES: u32 = 10;

/// What tells a client from others.
#[derive(Clone, Debug)]
pub struct ClientSettings {
    /// Determines what it asks for, in which order.
    pub seed: u64,
    /// A case that every second frame is of.
    pub case: Option<u64>,
    /// What it may ask for: engines and spheres.
    pub entrants: Vec<Entrant>,
    /// Precision modes.
    pub modes: Vec<ModeChoice>,
    /// Most threads of a frame.
    pub threads: usize,
    /// Whether the daemon has a GPU.
    pub with_gpu: bool,
    /// Whether it closes sessions whatever they have under way, as a client that is killed does.
    pub abrupt: bool,
}

impl ClientSettings {
    /// Runs the client until `is_over`. `out` gets lines for the process that started it.
    ///
    /// # Errors
    /// That of `out`.
    pub fn run(
        &self,
        daemon: &SessionBuilder,
        is_over: &AtomicBool,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let teller = Teller { out, counts: Counts::default(), told_at: Instant::now() };
        let mut client = Client::new(self, daemon, is_over, teller);
        let last = match client.run() {
            Ok(()) => Ended::Done,
            Err(Stop::Unheard(error)) => return Err(error),
            Err(Stop::GaveUp(why)) => Ended::GaveUp(why),
        };
        client.teller.tell()?;
        client.teller.say(&Said::Ended(last))
    }
}

/// Why a client ends before its time.
enum Stop {
    /// The other process does not listen.
    Unheard(io::Error),
    /// No session is to be had.
    GaveUp(String),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Unheard(error)
    }
}

/// Collects counts, and tells them now and then.
struct Teller<'a> {
    out: &'a mut dyn Write,
    counts: Counts,
    told_at: Instant,
}

impl Teller<'_> {
    fn say(&mut self, said: &Said) -> io::Result<()> {
        writeln!(self.out, "{}", said.line())?;
        self.out.flush()
    }

    fn tell(&mut self) -> io::Result<()> {
        self.told_at = Instant::now();
        let counts = std::mem::take(&mut self.counts);
        self.say(&Said::Counted(counts))
    }

    fn tell_now_and_then(&mut self) -> io::Result<()> {
        if self.told_at.elapsed() < TELL_INTERVAL { Ok(()) } else { self.tell() }
    }
}

/// A scene, which frames under way share.
struct Scene {
    id: CaseId,
    case: Case,
}

impl Scene {
    fn new(id: CaseId) -> Rc<Self> {
        Rc::new(Self { id, case: id.case() })
    }
}

struct UnderWay {
    pending: PendingFrame,
    scene: Rc<Scene>,
    form: Form,
}

struct Open {
    session: Session,
    way: Way,
    frames: VecDeque<UnderWay>,
    /// Its scene that persists, once there is one.
    kept: Option<KeptScene>,
}

impl Open {
    fn load(&self) -> Load {
        Load { under_way: self.frames.len(), most: self.way.depth }
    }
}

struct Client<'a> {
    offer: Offer,
    daemon: SessionBuilder,
    is_over: &'a AtomicBool,
    random: Random,
    steps: Steps,
    /// Scenes that stay.
    kept: Vec<Rc<Scene>>,
    stock: Vec<Rc<Scene>>,
    sessions: Vec<Open>,
    failures: u32,
    abrupt: bool,
    teller: Teller<'a>,
}

impl<'a> Client<'a> {
    fn new(
        settings: &ClientSettings,
        daemon: &SessionBuilder,
        is_over: &'a AtomicBool,
        teller: Teller<'a>,
    ) -> Self {
        let ClientSettings { seed, case, entrants, modes, threads, with_gpu, abrupt } = settings;
        let mut random = Random::new(*seed);
        let kept = case.iter().flat_map(|seed| {
            [false, true].map(|is_large| Scene::new(CaseId { seed: *seed, is_large }))
        });
        Self {
            offer: Offer::new(entrants, modes, *threads, *with_gpu),
            daemon: daemon.clone().deadline(DEADLINE),
            is_over,
            steps: Steps::new(random.bits()),
            random,
            kept: kept.collect(),
            stock: Vec::new(),
            sessions: Vec::new(),
            failures: 0,
            abrupt: *abrupt,
            teller,
        }
    }

    fn run(&mut self) -> Result<(), Stop> {
        self.teller.counts.cases += self.kept.len() as u64;
        for _ in 0..=self.random.below(MOST_SESSIONS) {
            let Some(open) = self.open()? else { return Ok(()) };
            self.sessions.push(open);
        }
        for _ in 0..STOCK {
            let scene = self.next_scene();
            self.stock.push(scene);
        }
        while !self.is_over.load(Ordering::Relaxed) && self.failures < MOST_FAILURES {
            let loads: Vec<Load> = self.sessions.iter().map(Open::load).collect();
            match self.steps.next(&loads) {
                Step::Send { session } => self.send(session)?,
                Step::Read { session, frame } => self.read(session, frame)?,
                Step::Leave { session, frame } => {
                    if self.sessions[session].frames.remove(frame).is_some() {
                        self.teller.counts.unread += 1;
                    }
                }
                Step::Pause(time) => std::thread::sleep(time),
                Step::ChangeScene => {
                    let place = self.random.below(STOCK as u64) as usize;
                    self.stock[place] = self.next_scene();
                }
                Step::Reconnect { session } => {
                    if !self.abrupt {
                        self.read_all(session)?;
                    }
                    self.teller.counts.unread += self.sessions[session].frames.len() as u64;
                    // Closed first: a client has no more sessions at a time than it may.
                    drop(self.sessions.swap_remove(session));
                    let Some(open) = self.open()? else { break };
                    self.sessions.push(open);
                }
            }
            self.teller.tell_now_and_then()?;
        }
        for session in 0..self.sessions.len() {
            self.read_all(session)?;
        }
        Ok(())
    }

    /// Reads all that a session has under way, and the answer to one frame more: then the daemon has
    /// received what was dropped before, too.
    fn read_all(&mut self, session: usize) -> io::Result<()> {
        while !self.sessions[session].frames.is_empty() && self.failures < MOST_FAILURES {
            self.read(session, 0)?;
        }
        if self.failures < MOST_FAILURES {
            self.send(session)?;
            self.read(session, 0)?;
        }
        Ok(())
    }

    fn next_scene(&mut self) -> Rc<Scene> {
        self.teller.counts.cases += 1;
        let seed = Case::next_seed(&mut self.random);
        Scene::new(CaseId { seed, is_large: self.random.below(LARGE_ONE_IN) == 0 })
    }

    /// A session through which the daemon answers; `None` where the run is over before there is one.
    fn open(&mut self) -> Result<Option<Open>, Stop> {
        let way = self.offer.draw(&mut self.random);
        let began = Instant::now();
        loop {
            let why = match way.apply(self.daemon.clone()).connect() {
                Ok(session) if session.served_by() == ServedBy::Daemon => {
                    self.teller.counts.sessions += 1;
                    return Ok(Some(Open { session, way, frames: VecDeque::new(), kept: None }));
                }
                Ok(_) => "the daemon takes no session".to_owned(),
                Err(error) => error.to_string(),
            };
            if self.is_over.load(Ordering::Relaxed) {
                return Ok(None);
            }
            if began.elapsed() >= DEADLINE {
                return Err(Stop::GaveUp(why));
            }
            std::thread::sleep(RETRY_INTERVAL);
        }
    }

    fn send(&mut self, session: usize) -> io::Result<()> {
        let is_kept = !self.kept.is_empty() && self.random.below(2) == 0;
        let scenes = if is_kept { &self.kept } else { &self.stock };
        let scene = Rc::clone(pick(scenes, &mut self.random));
        match self.sessions[session].way.next(&mut self.random) {
            Asked::Frame(form) => self.send_frame(session, scene, form),
            Asked::Edit => self.edit(session, &scene),
        }
    }

    fn send_frame(&mut self, session: usize, scene: Rc<Scene>, form: Form) -> io::Result<()> {
        let open = &mut self.sessions[session];
        self.teller.counts.frames += 1;
        match frame::send(&mut open.session, &scene.case, form) {
            Ok(pending) => {
                open.frames.push_back(UnderWay { pending, scene, form });
                Ok(())
            }
            Err(error) => self.fail(session, scene.id, Asked::Frame(form), Finding::other(&error)),
        }
    }

    /// Edits the session's scene towards the boxes of a case. One in a few begins anew.
    fn edit(&mut self, session: usize, scene: &Scene) -> io::Result<()> {
        // The edit needs a place of the session's.
        while self.sessions[session].frames.len() >= MOST_UNDER_WAY {
            self.read(session, 0)?;
        }
        if self.random.below(NEW_SCENE_ONE_IN) == 0 {
            self.sessions[session].kept = None;
        }
        let Open { session: of, kept, .. } = &mut self.sessions[session];
        let kept = kept.get_or_insert_with(|| KeptScene::new(of, &mut self.random));
        self.teller.counts.edits += 1;
        let finding = match kept.edit(&scene.case, &mut self.random) {
            Ok(Edited::Unread) => {
                self.teller.counts.unread += 1;
                return Ok(());
            }
            Ok(Edited::Right(by)) => {
                self.teller.counts.answers += 1;
                if by == ServedBy::Daemon {
                    return Ok(());
                }
                self.teller.counts.in_process += 1;
                Finding::other(&"the client answered it itself, the daemon did not")
            }
            Err(EditFailure::Wrong(finding)) => {
                self.teller.counts.answers += 1;
                finding
            }
            Err(EditFailure::Unanswered(error)) => {
                let is_late = matches!(error, CommitError::Wait(WaitError::Timeout { .. }));
                self.teller.counts.unanswered += u64::from(is_late);
                Finding::other(&error)
            }
        };
        self.sessions[session].kept = None;
        self.fail(session, scene.id, Asked::Edit, finding)
    }

    fn read(&mut self, session: usize, frame: usize) -> io::Result<()> {
        let Some(UnderWay { pending, scene, form }) = self.sessions[session].frames.remove(frame)
        else {
            return Ok(());
        };
        let answer = match frame::receive(pending, &scene.case) {
            Ok(answer) => answer,
            Err(error) => {
                self.teller.counts.unanswered +=
                    u64::from(matches!(error, WaitError::Timeout { .. }));
                return self.fail(session, scene.id, Asked::Frame(form), Finding::other(&error));
            }
        };
        let is_own = answer.served_by == ServedBy::InProcess;
        self.teller.counts.answers += 1;
        self.teller.counts.in_process += u64::from(is_own);
        if let Err(finding) = frame::check(&answer, &scene.case, form) {
            return self.fail(session, scene.id, Asked::Frame(form), finding);
        }
        if is_own {
            let finding = Finding::other(&"the client answered it itself, the daemon did not");
            return self.fail(session, scene.id, Asked::Frame(form), finding);
        }
        Ok(())
    }

    fn fail(
        &mut self,
        session: usize,
        case: CaseId,
        asked: Asked,
        finding: Finding,
    ) -> io::Result<()> {
        self.failures += 1;
        let way = self.sessions[session].way.to_string();
        self.teller.say(&Said::Failed(Box::new(FailedFrame { case, asked, way, finding })))
    }
}
