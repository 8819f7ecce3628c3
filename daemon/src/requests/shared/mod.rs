//! Scenes that several sessions write: found by name, locked each by itself.
//!
//! A commit keeps its request until its tick ends. The thread that ends the tick answers all members: the worker thread that
//! takes the last commit in, or the thread of the deadlines.
//!
//! ```text
//! scene     one scene: what its members do, and in which order its locks are taken
//! seats     members, leases, the open tick
//! boxes     the boxes, by which edits are checked, and what edits have changed
//! tick      the end of a tick: edits are applied, members answered
//! ```

mod boxes;
mod scene;
mod seats;
mod tick;

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::time::Instant;

use pairmask_core::scene::shared::{AtEnd, MemberId};
use pairmask_transport::Share;
use pairmask_wire::{
    AgreedTerms, JoinRequest, LeaseRequest, ObserveRequest, Reject, SceneId, SceneName,
    SceneRequest, response_joined, response_leased, response_scene_ended,
};

use self::scene::SharedScene;
use super::asked::Asked;
use super::scene::SceneTools;
use super::{EndWithPanic, GpuNeed, Served, threads_of};
use crate::execute::{CpuTimer, EnginePool};
use crate::locked;
use crate::publish::{OpenRequest, Outbox, Refusal};
use crate::serve::{ServeError, StoppedThread};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// Its session joins again: it has lost what it knew, and sends all of its boxes next.
    JoinsAgain,
    Left,
    SessionGone,
}

/// A membership: by session and by the client's own number.
type MemberKey = (u64, SceneId);

pub(super) struct SharedScenes {
    tools: SceneTools,
    outbox: Arc<Outbox>,
    by_name: Mutex<BTreeMap<SceneName, Arc<SharedScene>>>,
    joined: Mutex<HashMap<MemberKey, (Arc<SharedScene>, MemberId)>>,
    alarm: Alarm,
}

impl SharedScenes {
    pub(super) fn new(tools: SceneTools, outbox: Arc<Outbox>) -> Result<Self, ServeError> {
        let alarm = Alarm::start(Arc::clone(&tools.pool), Arc::clone(&outbox))?;
        Ok(Self { tools, outbox, by_name: Mutex::default(), joined: Mutex::default(), alarm })
    }

    pub(super) fn join(&self, open: OpenRequest, request: &JoinRequest) {
        let session = open.sender.session;
        self.end((session, request.scene), End::JoinsAgain);
        let joined = match SceneName::read(request, open.pages()) {
            Some(name) => self.join_named(&name, &open, request),
            None => Err(Reject::Edit("name").into()),
        };
        let header = joined.map(|terms| response_joined(&open.fields, &terms));
        self.outbox.send_and_close(open, header);
    }

    fn join_named(
        &self,
        name: &SceneName,
        open: &OpenRequest,
        request: &JoinRequest,
    ) -> Result<AgreedTerms, Refusal> {
        loop {
            let scene = self.of_name(name, request, open.share())?;
            // Its last member may have left since it was found.
            let Some(joined) = scene.join(request) else { continue };
            let terms = scene.terms;
            match joined {
                Ok(member) => {
                    locked(&self.joined)
                        .insert((open.sender.session, request.scene), (scene, member));
                    return Ok(terms);
                }
                Err(refusal) => {
                    self.discard_if_ended(&scene);
                    return Err(refusal);
                }
            }
        }
    }

    /// The scene of a name, made where there is none. One that has ended is replaced.
    fn of_name(
        &self,
        name: &SceneName,
        request: &JoinRequest,
        share: &Share,
    ) -> Result<Arc<SharedScene>, Refusal> {
        let mut by_name = locked(&self.by_name);
        if let Some(scene) = by_name.get(name).filter(|scene| !scene.seats().has_ended) {
            return Ok(Arc::clone(scene));
        }
        let scene = SharedScene::begin(name.clone(), request, self.tools.clone(), share)?;
        let scene = Arc::new(scene);
        by_name.insert(name.clone(), Arc::clone(&scene));
        Ok(scene)
    }

    pub(super) fn lease(&self, open: OpenRequest, request: &LeaseRequest) {
        let found = self.find((open.sender.session, request.scene));
        let leased = found.ok_or_else(|| Refusal::stale_scene(0)).and_then(|(scene, member)| {
            let leased = scene.lease(member, request.action);
            // A writer less may end the tick.
            scene.end_tick(&self.tools.pool, &self.outbox);
            leased
        });
        let header = leased.map(|range| response_leased(&open.fields, &range));
        self.outbox.send_and_close(open, header);
    }

    /// Takes a commit in. It is answered when its tick ends, by this call where it is the last one: by all
    /// threads, as all who have committed wait for it.
    pub(super) fn commit(&self, open: OpenRequest, request: &SceneRequest) -> Served {
        let timer = CpuTimer::start();
        let Some((scene, member)) = self.find((open.sender.session, request.scene)) else {
            return self.outbox.refuse_and_close(open, Refusal::stale_scene(0));
        };
        if let Err(refused) = scene.commit(member, open, request) {
            let (open, refusal) = *refused;
            return self.outbox.refuse_and_close(open, refusal);
        }
        // By this its next commit is judged, which may be another one than the last of its tick.
        let on_one_core = Some(timer.elapsed());
        let threads = scene.end_tick(&self.tools.pool, &self.outbox);
        let closes_at = scene.seats().closes_at();
        if let Some(closes_at) = closes_at {
            self.alarm.set(closes_at, &scene);
        }
        Served { threads, on_one_core, ..Served::BEGUN }
    }

    /// Answers a query or a cast.
    pub(super) fn ask(&self, mut open: OpenRequest, asked: Asked<'_>, threads: usize) -> Served {
        let Some((scene, _)) = self.find((open.sender.session, asked.scene())) else {
            return self.outbox.refuse_and_close(open, Refusal::stale_scene(0));
        };
        let threads = threads_of(asked.threads(), threads);
        let answer = || scene.ask(&mut open, asked, threads, &self.outbox);
        let answered = self.tools.pool.work_by(threads, answer);
        if let Err(refusal) = &answered {
            self.outbox.refuse(&mut open, refusal);
        }
        drop(open);
        let on_gpu = answered.unwrap_or(false);
        let gpu = if on_gpu { GpuNeed::Alone } else { GpuNeed::None };
        Served { threads, on_gpu, gpu, ..Served::BEGUN }
    }

    /// Answers which boxes changed.
    pub(super) fn observe(&self, mut open: OpenRequest, request: &ObserveRequest) {
        let found = self.find((open.sender.session, request.scene));
        let observed = found
            .ok_or_else(|| Refusal::stale_scene(0))
            .and_then(|(scene, _)| scene.observe(&mut open, request.after));
        self.outbox.send_and_close(open, observed);
    }

    pub(super) fn leave(&self, open: &mut OpenRequest, scene: SceneId) {
        self.end((open.sender.session, scene), End::Left);
        let header = response_scene_ended(&open.fields);
        open.send(&header);
    }

    pub(super) fn tidy(&self) {
        let mut members: Vec<MemberKey> = locked(&self.joined).keys().copied().collect();
        if members.is_empty() {
            return;
        }
        // After the members: a session that comes meanwhile is none of theirs.
        let sessions = self.outbox.sessions();
        members.retain(|(session, _)| !sessions.contains(session));
        for key in members {
            self.end(key, End::SessionGone);
        }
    }

    /// Ends a membership, if there is one. A session that lives is informed that a commit has no answer.
    fn end(&self, key: MemberKey, why: End) {
        let Some((scene, member)) = locked(&self.joined).remove(&key) else { return };
        let at_end = match why {
            // What it does not send again is to be removed: it may have removed that in an edit that was lost.
            End::JoinsAgain => AtEnd::Remove,
            End::Left | End::SessionGone => scene.terms.at_end,
        };
        if let Some(mut open) = scene.end_member(member, at_end) {
            if why != End::SessionGone {
                self.outbox.refuse(&mut open, &Refusal::stale_scene(0));
            }
            drop(open);
        }
        scene.end_tick(&self.tools.pool, &self.outbox);
        self.discard_if_ended(&scene);
    }

    fn find(&self, key: MemberKey) -> Option<(Arc<SharedScene>, MemberId)> {
        locked(&self.joined).get(&key).cloned()
    }

    fn discard_if_ended(&self, scene: &Arc<SharedScene>) {
        if !scene.seats().end_without_members() {
            return;
        }
        let mut by_name = locked(&self.by_name);
        if by_name.get(&scene.name).is_some_and(|there| Arc::ptr_eq(there, scene)) {
            by_name.remove(&scene.name);
        }
    }
}

/// The thread of the deadlines, which sleeps where there are none.
struct Alarm {
    due: Arc<Mutex<Due>>,
    thread: StoppedThread,
}

/// Deadlines, one a scene. A scene whose tick has ended meanwhile is looked at in vain.
type Due = Vec<(Instant, Weak<SharedScene>)>;

/// Has a scene's tick end at a time, once. Whether that is sooner than it was.
fn set(due: &mut Due, at: Instant, scene: Weak<SharedScene>) -> bool {
    let known = due.iter_mut().find(|(_, known)| known.ptr_eq(&scene));
    match known {
        // An earlier look finds the tick open, and is set again.
        Some((known, _)) if *known <= at => return false,
        Some((known, _)) => *known = at,
        None => due.push((at, scene)),
    }
    true
}

impl Alarm {
    fn start(pool: Arc<EnginePool>, outbox: Arc<Outbox>) -> Result<Self, ServeError> {
        let due: Arc<Mutex<Due>> = Arc::default();
        let watched = Arc::clone(&due);
        let work = move |stop: &AtomicBool| watch(&watched, &pool, &outbox, stop);
        let thread = StoppedThread::start("deadlines", "starting the thread of deadlines", work)?;
        Ok(Self { due, thread })
    }

    fn set(&self, at: Instant, scene: &Arc<SharedScene>) {
        if set(&mut locked(&self.due), at, Arc::downgrade(scene)) {
            self.thread.wake();
        }
    }
}

fn watch(due: &Mutex<Due>, pool: &EnginePool, outbox: &Outbox, stop: &AtomicBool) {
    let _end = EndWithPanic;
    while !stop.load(Ordering::Relaxed) {
        let now = Instant::now();
        let mut waiting = locked(due);
        let rung: Vec<_> = waiting.extract_if(.., |(at, _)| *at <= now).collect();
        let next = waiting.iter().map(|(at, _)| *at).min();
        drop(waiting);
        for (_, scene) in &rung {
            let Some(scene) = scene.upgrade() else { continue };
            scene.end_tick(pool, outbox);
            let closes_at = scene.seats().closes_at();
            if let Some(at) = closes_at {
                // A worker thread may have set it meanwhile.
                set(&mut locked(due), at, Arc::downgrade(&scene));
            }
        }
        if rung.is_empty() {
            // A deadline that was set since then, and the end, have left their wake-ups.
            match next {
                Some(at) => std::thread::park_timeout(at - now),
                None => std::thread::park(),
            }
        }
    }
}
