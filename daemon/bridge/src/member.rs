//! The bridge as a member of its machine's shared scene: it observes what the others write, and writes ghosts.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::time::{Duration, Instant};

use pairmask::filters::{Filter, FilterData, FilterId, FilterTable};
use pairmask::{Aabb, AtEnd, Backend, Error, Report, Scene, SceneOptions, Session};

use crate::ids::MachineId;
use crate::node::Ghost;
use crate::session::{IndexNow, Local};
use crate::state::BoxState;

/// Ghosts that are leased at once: a lease is a request, and a scene has 4,096 at the most.
const LEASED_AT_ONCE: u32 = 4_096;
/// How long the first lease waits for a box of another member: who has the lowest lease gives the table of filters, and a
/// bridge has none to give.
const FIRST_LEASE_WAIT: Duration = Duration::from_secs(5);

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

/// A ghost in this scene.
#[derive(Clone, Copy, Debug)]
struct Written {
    /// Its index here.
    at: u32,
    /// What it is on its machine.
    local: Local,
    /// Its filter data here: its filter is in this scene's table.
    filter_data: FilterData,
}

/// The membership.
pub struct Member {
    _session: Session,
    scene: Scene,
    joined: Instant,
    free: BTreeSet<u32>,
    /// By machines and indices there.
    ghosts: HashMap<(MachineId, u32), Written>,
    /// Indices of others' boxes here.
    known: HashSet<u32>,
    /// The scene's filters.
    filters: FilterTable,
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
            joined: Instant::now(),
            free: BTreeSet::new(),
            ghosts: HashMap::new(),
            known: HashSet::new(),
            filters: FilterTable::default(),
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

    /// Commits the ghosts, waits for the end of the tick, and returns what became of the other members' boxes, and whether
    /// the ghosts were committed: those that were not are committed with the next tick.
    ///
    /// # Errors
    /// [`Error`].
    pub fn tick(&mut self) -> Result<(Vec<IndexNow>, Result<(), Error>), Error> {
        let committed = self.commit();
        let observed = self.scene.observe()?;
        let own: Vec<_> = self.scene.leases().to_vec();
        let is_own = |index: u32| own.iter().any(|range| range.contains(&index));
        if let Some(filters) = observed.filters.filter(|filters| *filters != self.filters) {
            self.filters = filters;
            for (key, ghost) in &self.ghosts {
                let (_, state) = &ghost.local;
                if local_filter_data(state, &self.filters) != ghost.filter_data {
                    self.due.entry(*key).or_insert(Some(ghost.local));
                }
            }
        }
        let mut gone = if observed.is_whole { self.known.clone() } else { HashSet::new() };
        let mut changes = Vec::new();
        for of in observed.boxes.iter().filter(|of| !is_own(of.index)) {
            gone.remove(&of.index);
            let state = BoxState {
                aabb: of.aabb,
                filter_data: of.filter_data,
                filter: self.filters.get(of.filter_data.filter),
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
        Ok((changes, committed))
    }

    fn commit(&mut self) -> Result<(), Error> {
        let new = self.due.keys().filter(|key| !self.ghosts.contains_key(*key)).count();
        let missing = new.saturating_sub(self.free.len()) as u32;
        let is_first = self.scene.leases().is_empty();
        if is_first && self.known.is_empty() && self.joined.elapsed() < FIRST_LEASE_WAIT {
            return Ok(());
        }
        // A first lease also where there is no ghost yet: who has none is not waited for, and sees ticks pass by.
        let leased = if missing > 0 || is_first { self.lease(missing.max(1)) } else { Ok(()) };
        let (mut sets, mut left_over) = (Vec::new(), BTreeMap::new());
        for (key, state) in &self.due {
            let was = self.ghosts.get(key).copied();
            let Some(state) = *state else {
                if let Some(ghost) = self.ghosts.remove(key) {
                    self.removed.insert(ghost.at);
                }
                continue;
            };
            let Some(at) = was.map_or_else(|| self.free.pop_last(), |was| Some(was.at)) else {
                left_over.insert(*key, Some(state));
                continue;
            };
            let was = was.filter(|was| was.local.0 == state.0);
            if was.is_none() {
                // Another box, also where the index had one.
                self.removed.insert(at);
            }
            let filter_data = local_filter_data(&state.1, &self.filters);
            let now = Written { at, local: state, filter_data };
            self.ghosts.insert(*key, now);
            sets.push((was, now));
        }
        let has_box = |index: &u32| self.scene.get(*index).is_some();
        let removed: Vec<u32> = self.removed.iter().copied().filter(has_box).collect();
        let indices: Vec<u32> = sets.iter().map(|(_, now)| now.at).collect();
        let boxes: Vec<Aabb> = sets.iter().map(|(_, now)| now.local.1.aabb).collect();
        let all = self.has_failed;
        let mut edit = self.scene.edit().remove_all(&removed).set_all(&indices, &boxes);
        for (was, Written { at, local: (_, state), filter_data }) in &sets {
            let was_state = was.map_or(BoxState::from(Aabb::EMPTY), |was| was.local.1);
            if all || was_state.is_enabled != state.is_enabled {
                edit = edit.set_enabled(*at, state.is_enabled);
            }
            if all || was.map_or(FilterData::default(), |was| was.filter_data) != *filter_data {
                edit = edit.make_static(*at, filter_data.is_static());
                edit = edit.set_filter(*at, filter_data.with_static(false));
            }
            if all || was_state.user_data != state.user_data {
                edit = edit.set_user_data(*at, state.user_data);
            }
        }
        let committed = edit.commit(Report::Nothing).map(drop);
        self.has_failed = committed.is_err();
        if committed.is_ok() {
            self.due = left_over;
            let used: HashSet<u32> = indices.into_iter().collect();
            let freed = std::mem::take(&mut self.removed);
            self.free.extend(freed.into_iter().filter(|at| !used.contains(at)));
        }
        committed.and(leased)
    }

    /// Leases so many indices at the least: some more, where there is room.
    fn lease(&mut self, count: u32) -> Result<(), Error> {
        let leased = self.scene.lease_any(count.next_multiple_of(LEASED_AT_ONCE));
        self.free.extend(leased.or_else(|_| self.scene.lease_any(count))?);
        Ok(())
    }
}

/// Filter data for a ghost in a scene with a table: the place of a filter like its own. Where there is none, it keeps the
/// number that it has on its machine.
fn local_filter_data(state: &BoxState, filters: &FilterTable) -> FilterData {
    let like = |filter: FilterId| filters.get(filter) == state.filter;
    if like(state.filter_data.filter) {
        return state.filter_data;
    }
    let all = filters.filters();
    let found = all.iter().position(|filter| *filter == state.filter);
    // An id beyond the last one is the filter that meets all.
    let beyond = (state.filter == Filter::ALL).then_some(all.len());
    let id = found.or(beyond).and_then(|at| u16::try_from(at).ok());
    id.map_or(state.filter_data, |id| state.filter_data.with_filter(FilterId(id)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pairmask::filters::World;

    #[test]
    fn a_ghost_has_a_filter_like_its_own() {
        let [own, other] = [Filter::new(1, 2), Filter::new(2, 1)];
        let filter_data = FilterData::default().with_world(World(3)).with_filter(FilterId(1));
        let state = BoxState { filter_data, filter: own, ..BoxState::from(Aabb::EMPTY) };
        let of = |filters: &[Filter]| {
            local_filter_data(&state, &FilterTable::new(filters).expect("few"))
        };
        assert_eq!(of(&[own, own]), filter_data, "also where another one is like it");
        assert_eq!(of(&[other, other, own]), filter_data.with_filter(FilterId(2)));
        assert_eq!(of(&[other, other]), filter_data, "none is like it");
        let all = BoxState::from(Aabb::EMPTY);
        let two = FilterTable::new(&[own, other]).expect("two");
        assert_eq!(local_filter_data(&all, &two).filter, FilterId(2), "beyond the table");
    }
}
