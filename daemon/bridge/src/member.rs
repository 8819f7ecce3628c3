//! The bridge as a member of its machine's shared scene: it observes what the others write, and writes ghosts.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::time::Duration;

use pairmask::{Aabb, AtEnd, Backend, Error, Report, Scene, SceneOptions, Session};

use crate::ids::MachineId;
use crate::node::Ghost;
use crate::session::Local;
use crate::state::BoxState;

/// Ghosts that are leased at once: a lease is a request, and a scene has 4,096 at the most.
const LEASED_AT_ONCE: u32 = 4_096;

/// How to find the scene.
#[derive(Clone, Debug, Default)]
pub struct Place {
    /// Its name.
    pub scene: String,
    /// The daemon's instance; `None` for the usual one.
    pub instance: Option<String>,
    /// What becomes of a lost machine's ghosts; `None`: as the scene says.
    pub at_end: Option<AtEnd>,
    /// How long a tick waits for a writer; `None`: as the scene says.
    pub deadline: Option<Duration>,
}

/// The membership.
pub struct Member {
    _session: Session,
    scene: Scene,
    free: BTreeSet<u32>,
    /// Indices of this scene by those of other machines.
    ghosts: HashMap<(MachineId, u32), (u32, Local)>,
    /// Indices of others' boxes here.
    known: HashSet<u32>,
    /// Ghosts of the next commit, and indices whose boxes it removes.
    due: BTreeMap<(MachineId, u32), Option<Local>>,
    removed: BTreeSet<u32>,
    /// Whether the last commit failed: what it was to do is done again.
    has_failed: bool,
}

impl Member {
    /// Joins the scene.
    ///
    /// # Errors
    /// [`Error`].
    pub fn join(place: &Place) -> Result<Self, Error> {
        let mut builder = Session::builder().backend(Backend::Daemon);
        if let Some(instance) = &place.instance {
            builder = builder.instance(instance);
        }
        let mut session = builder.connect()?;
        let mut options = SceneOptions::default().with_shared(&place.scene);
        (options.at_end, options.tick_deadline) = (place.at_end, place.deadline);
        let scene = session.scene(options)?;
        Ok(Self {
            _session: session,
            scene,
            free: BTreeSet::new(),
            ghosts: HashMap::new(),
            known: HashSet::new(),
            due: BTreeMap::new(),
            removed: BTreeSet::new(),
            has_failed: false,
        })
    }

    /// What becomes of a writer's boxes that ends.
    pub fn at_end(&self) -> AtEnd {
        self.scene.at_end().unwrap_or_default()
    }

    /// Takes ghosts in, for the next commit.
    pub fn add(&mut self, ghosts: Vec<Ghost>) {
        self.due.extend(ghosts.into_iter().map(|of| ((of.machine, of.index), of.state)));
    }

    /// Commits the ghosts, waits for the end of the tick, and returns what became of the other members' boxes.
    ///
    /// # Errors
    /// [`Error`]. What was to be committed is committed with the next tick then.
    pub fn tick(&mut self) -> Result<Vec<(u32, Option<Local>)>, Error> {
        self.commit()?;
        let observed = self.scene.observe()?;
        let own: Vec<_> = self.scene.leases().to_vec();
        let is_own = |index: u32| own.iter().any(|range| range.contains(&index));
        let mut gone = if observed.is_whole { self.known.clone() } else { HashSet::new() };
        let mut changes = Vec::new();
        for of in observed.boxes.iter().filter(|of| !is_own(of.index)) {
            gone.remove(&of.index);
            let state = BoxState {
                aabb: of.aabb,
                filter_data: of.filter_data,
                user_data: of.user_data,
                is_enabled: of.is_enabled(),
            };
            if of.is_present() {
                self.known.insert(of.index);
                changes.push((of.index, Some((of.incarnation, state))));
            } else if self.known.remove(&of.index) {
                changes.push((of.index, None));
            }
        }
        for index in gone {
            self.known.remove(&index);
            changes.push((index, None));
        }
        Ok(changes)
    }

    fn commit(&mut self) -> Result<(), Error> {
        let missing = self.due.len().saturating_sub(self.free.len()) as u32;
        // A first lease also where there is no ghost yet: who has none is not waited for, and sees ticks pass by.
        if missing > 0 || self.scene.leases().is_empty() {
            let range = self.scene.lease_any(missing.max(1).next_multiple_of(LEASED_AT_ONCE))?;
            self.free.extend(range);
        }
        let mut sets = Vec::new();
        for (key, state) in &self.due {
            let was = self.ghosts.get(key).copied();
            let Some(state) = *state else {
                if let Some((at, _)) = self.ghosts.remove(key) {
                    self.removed.insert(at);
                }
                continue;
            };
            let Some(at) = was.map_or_else(|| self.free.pop_last(), |(at, _)| Some(at)) else {
                continue;
            };
            let was = was.map(|(_, was)| was).filter(|(incarnation, _)| *incarnation == state.0);
            if was.is_none() {
                // Another box, also where the index had one.
                self.removed.insert(at);
            }
            self.ghosts.insert(*key, (at, state));
            sets.push((at, was.map(|(_, was)| was), state.1));
        }
        let has_box = |index: &u32| self.scene.get(*index).is_some();
        let removed: Vec<u32> = self.removed.iter().copied().filter(has_box).collect();
        let indices: Vec<u32> = sets.iter().map(|(at, ..)| *at).collect();
        let boxes: Vec<Aabb> = sets.iter().map(|(.., state)| state.aabb).collect();
        let all = self.has_failed;
        let mut edit = self.scene.edit().remove_all(&removed).set_all(&indices, &boxes);
        for (at, was, state) in &sets {
            if all || was.map_or(!state.is_enabled, |was| was.is_enabled != state.is_enabled) {
                edit = edit.set_enabled(*at, state.is_enabled);
            }
            let filter_data = was.map(|was| was.filter_data).unwrap_or_default();
            if all || filter_data != state.filter_data {
                edit = edit.make_static(*at, state.filter_data.is_static());
                edit = edit.set_filter(*at, state.filter_data.with_static(false));
            }
            if all || was.map_or(0, |was| was.user_data) != state.user_data {
                edit = edit.set_user_data(*at, state.user_data);
            }
        }
        let committed = edit.commit(Report::Nothing).map(drop);
        self.has_failed = committed.is_err();
        if committed.is_ok() {
            self.due.clear();
            let used: HashSet<u32> = indices.into_iter().collect();
            let freed = std::mem::take(&mut self.removed);
            self.free.extend(freed.into_iter().filter(|at| !used.contains(at)));
        }
        committed
    }
}
