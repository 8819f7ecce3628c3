//! Scenes that several sessions write: found by name, locked each by itself.
//!
//! A commit keeps its request until its tick ends. Whoever ends the tick answers all members: the lane that
//! takes the last commit in, or the thread of the deadlines.
//!
//! ```text
//! scene     one scene: members, leases, the open tick; what is applied and answered when it ends
//! member    what is kept of one member
//! alarm     the thread that ends ticks whose deadline has passed
//! ```

mod alarm;
mod member;
mod scene;

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use pairmask_core::engine::AvailableIsa;
use pairmask_core::plan::Calibration;
use pairmask_core::scene::shared::MemberId;
use pairmask_wire::{
    AgreedTerms, JoinRequest, LeaseRequest, Reject, SceneId, SceneName, SceneRequest,
    response_joined, response_leased,
};

use self::alarm::Alarm;
use self::scene::SharedScene;
use super::Served;
use crate::clients::SceneMemory;
use crate::execute::{EnginePool, Gpus};
use crate::publish::{OpenRequest, Outbox, Refusal};

/// What scenes are made with.
#[derive(Clone)]
pub(super) struct Tools {
    pub(super) isa: AvailableIsa,
    pub(super) calibration: Calibration,
    pub(super) gpus: Gpus,
    pub(super) memory: SceneMemory,
    pub(super) pool: Arc<EnginePool>,
}

/// A scene that several threads reach.
type Cell = Mutex<SharedScene>;

/// A membership: by session and by the client's own number.
type MemberKey = (u128, SceneId);

/// All shared scenes.
pub(super) struct SharedScenes {
    tools: Tools,
    by_name: Mutex<BTreeMap<SceneName, Arc<Cell>>>,
    joined: Mutex<HashMap<MemberKey, (Arc<Cell>, MemberId)>>,
    alarm: Alarm,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SharedScenes {
    pub(super) fn new(tools: Tools) -> Self {
        let alarm = Alarm::new(Arc::clone(&tools.pool));
        Self { tools, by_name: Mutex::default(), joined: Mutex::default(), alarm }
    }

    /// Answers a request to join.
    pub(super) fn join(&self, mut open: OpenRequest, request: &JoinRequest, outbox: &Arc<Outbox>) {
        let session = open.sender().session;
        // A member that joins again has lost what it knew: its first life ends.
        self.end((session, request.scene), true, outbox);
        let joined = match SceneName::read(request, open.pages()) {
            Some(name) => self.join_named(&name, session, request, outbox),
            None => Err(Reject::Edit { field: "name" }.into()),
        };
        match joined {
            Ok(terms) => {
                let header = response_joined(open.fields(), &terms);
                outbox.answer_shared(&mut open, &header);
            }
            Err(refusal) => outbox.refuse(&mut open, &refusal),
        }
        open.close();
    }

    fn join_named(
        &self,
        name: &SceneName,
        session: u128,
        request: &JoinRequest,
        outbox: &Arc<Outbox>,
    ) -> Result<AgreedTerms, Refusal> {
        self.alarm.start(outbox)?;
        loop {
            let cell = self.of_name(name, request)?;
            let mut scene = locked(&cell);
            // Its last member may have left since it was found.
            if scene.has_ended() {
                continue;
            }
            let joined = scene.join(request);
            let terms = scene.terms();
            let member = match joined {
                Ok(member) => member,
                Err(refusal) => {
                    let ended = scene.end_without_members();
                    drop(scene);
                    if ended {
                        self.forget(name, &cell);
                    }
                    return Err(refusal);
                }
            };
            drop(scene);
            locked(&self.joined).insert((session, request.scene), (cell, member));
            return Ok(terms);
        }
    }

    /// The scene of a name, made where there is none. One that has ended is replaced.
    fn of_name(&self, name: &SceneName, request: &JoinRequest) -> Result<Arc<Cell>, Refusal> {
        let mut by_name = locked(&self.by_name);
        if let Some(cell) = by_name.get(name) {
            // Another thread may hold it: one that it ends is taken out of this list right after.
            let has_ended = cell.try_lock().is_ok_and(|scene| scene.has_ended());
            if !has_ended {
                return Ok(Arc::clone(cell));
            }
        }
        let scene = SharedScene::begin(name.clone(), request, self.tools.clone())?;
        let cell = Arc::new(Mutex::new(scene));
        by_name.insert(name.clone(), Arc::clone(&cell));
        Ok(cell)
    }

    /// Answers a request about a lease.
    pub(super) fn lease(&self, mut open: OpenRequest, request: &LeaseRequest, outbox: &Outbox) {
        let found = self.find((open.sender().session, request.scene));
        let leased = found.ok_or_else(|| Refusal::stale_scene(0)).and_then(|(cell, member)| {
            let mut scene = locked(&cell);
            let leased = scene.lease(member, request.action);
            // A writer less may end the tick.
            self.end_tick(&mut scene, 1, outbox);
            leased
        });
        match leased {
            Ok(range) => {
                let header = response_leased(open.fields(), &range);
                outbox.answer_shared(&mut open, &header);
            }
            Err(refusal) => outbox.refuse(&mut open, &refusal),
        }
        open.close();
    }

    /// Takes a commit in. It is answered when its tick ends, by this call where it is the last one.
    pub(super) fn commit(
        &self,
        mut open: OpenRequest,
        request: &SceneRequest,
        threads: usize,
        outbox: &Outbox,
    ) -> Served {
        let threads = request.threads.map_or(threads, |asked| asked.min(threads)).max(1);
        let Some((cell, member)) = self.find((open.sender().session, request.scene)) else {
            outbox.refuse(&mut open, &Refusal::stale_scene(0));
            open.close();
            return Served::BEGUN;
        };
        let mut scene = locked(&cell);
        if let Err((mut open, refusal)) = scene.commit(member, open, request, Instant::now()) {
            drop(scene);
            outbox.refuse(&mut open, &refusal);
            open.close();
            return Served::BEGUN;
        }
        self.end_tick(&mut scene, threads, outbox);
        let closes_at = scene.closes_at();
        drop(scene);
        if let Some(closes_at) = closes_at {
            self.alarm.set(closes_at, &cell);
        }
        Served { threads, ..Served::BEGUN }
    }

    /// Answers a request to leave.
    pub(super) fn leave(&self, open: &mut OpenRequest, scene: SceneId, outbox: &Outbox) {
        self.end((open.sender().session, scene), true, outbox);
        outbox.answer_scene_ended(open);
    }

    /// Ends members whose sessions are gone; to be called now and then.
    pub(super) fn tidy(&self, lives: impl Fn(u128) -> bool, outbox: &Outbox) {
        let gone: Vec<MemberKey> =
            locked(&self.joined).keys().filter(|(session, _)| !lives(*session)).copied().collect();
        for key in gone {
            self.end(key, false, outbox);
        }
    }

    /// Ends a membership, if there is one. A session that lives is told that a commit has no answer.
    fn end(&self, key: MemberKey, lives: bool, outbox: &Outbox) {
        let Some((cell, member)) = locked(&self.joined).remove(&key) else { return };
        let mut scene = locked(&cell);
        if let Some(mut open) = scene.end_member(member) {
            if lives {
                outbox.refuse(&mut open, &Refusal::stale_scene(0));
            }
            open.close();
        }
        self.end_tick(&mut scene, 1, outbox);
        let ended = scene.end_without_members();
        let name = scene.name().clone();
        drop(scene);
        if ended {
            self.forget(&name, &cell);
        }
    }

    fn end_tick(&self, scene: &mut SharedScene, threads: usize, outbox: &Outbox) {
        end_tick(scene, threads, &self.tools.pool, outbox);
    }

    fn find(&self, key: MemberKey) -> Option<(Arc<Cell>, MemberId)> {
        locked(&self.joined).get(&key).cloned()
    }

    fn forget(&self, name: &SceneName, cell: &Arc<Cell>) {
        let mut by_name = locked(&self.by_name);
        if by_name.get(name).is_some_and(|there| Arc::ptr_eq(there, cell)) {
            by_name.remove(name);
        }
    }
}

/// Ends the open tick of a scene if that is due, by so many threads.
fn end_tick(scene: &mut SharedScene, threads: usize, pool: &EnginePool, outbox: &Outbox) {
    let Some(closed) = scene.close_tick(Instant::now()) else { return };
    if threads == 1 {
        scene.answer_tick(&closed, 1, outbox);
    } else {
        pool.work(|| scene.answer_tick(&closed, threads, outbox));
    }
}
