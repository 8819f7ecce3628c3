//! The model: what boxes and filters there are, all pairs of now, and what is to be reported to a listener.
//!
//! A pair is named by the indices of its boxes and their generations: a box that is removed ends, and one that
//! is set at its index is another. What a listener receives is the difference of two sets of such pairs.

use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData};
use pairmask_core::scene::QueryFilterData;

use super::script::{EndReason, Ended, Mode, Op, Pair};

/// Changes that are reported as such even where all pairs are fewer.
const RESYNC_LEAST: usize = 4_096;

/// Pairs, with the generations of their indices.
pub type PairsByGeneration = BTreeMap<Pair, [u32; 2]>;

#[derive(Clone, Copy, Debug)]
struct Body {
    b: Aabb,
    is_on: bool,
    is_static: bool,
    filter_data: FilterData,
    holder: u64,
}

#[derive(Clone, Debug, Default)]
pub struct Model {
    bodies: BTreeMap<u32, Body>,
    generations: BTreeMap<u32, u32>,
    /// By index: that of a removed box stays until another has its index.
    user_data: BTreeMap<u32, u64>,
    filters: Vec<Filter>,
    /// Listed pairs, each with the membership that has listed it.
    included: BTreeMap<Pair, u64>,
    excluded: BTreeMap<Pair, u64>,
}

impl Model {
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }

    /// Applies an edit of a membership: removals, sets, flags, filters, each in the order given. Returns the
    /// boxes that it names.
    pub fn apply(&mut self, holder: u64, ops: &[Op]) -> BTreeSet<u32> {
        let mut named = BTreeSet::new();
        for op in (0..4).flat_map(|rank| ops.iter().filter(move |op| op.rank() == rank)) {
            if !matches!(op, Op::UserData(..)) {
                named.extend(op.indices());
            }
            match op {
                Op::Remove(index) => self.remove(*index),
                Op::Set(index, b) => {
                    let filter_data = FilterData::default();
                    let fresh = Body { b: *b, is_on: true, is_static: false, filter_data, holder };
                    let is_new = !self.bodies.contains_key(index);
                    let body = self.bodies.entry(*index).or_insert(fresh);
                    let is_own = body.holder == holder;
                    if is_new || !is_own {
                        self.user_data.remove(index);
                    }
                    *body = if is_own { Body { b: *b, ..*body } } else { fresh };
                    if !is_own {
                        // A box that a member has left is that of who sets it next, and as that one says.
                        self.retain_listed(|pair, by| by == holder || !pair.contains(index));
                    }
                }
                Op::Enable(index, on) => self.with(*index, |body| body.is_on = *on),
                Op::Static(index, on) => self.with(*index, |body| body.is_static = *on),
                Op::FilterData(index, filter_data) => {
                    self.with(*index, |body| body.filter_data = *filter_data);
                }
                Op::UserData(index, user_data) => {
                    self.user_data.insert(*index, *user_data);
                }
                Op::Filters(filters) => {
                    let before = std::mem::replace(&mut self.filters, filters.clone());
                    let differs = |body: &Body| filter(&before, body) != filter(filters, body);
                    let bodies = self.bodies.iter().filter(|(_, body)| differs(body));
                    named.extend(bodies.map(|(index, _)| *index));
                }
                Op::Include(pair, on) => put(&mut self.included, *pair, on.then_some(holder)),
                Op::Exclude(pair, on) => put(&mut self.excluded, *pair, on.then_some(holder)),
            }
        }
        named
    }

    fn with(&mut self, index: u32, change: impl FnOnce(&mut Body)) {
        self.bodies.get_mut(&index).map(change).expect("scripts name boxes that there are");
    }

    pub fn remove(&mut self, index: u32) {
        if self.bodies.remove(&index).is_some() {
            *self.generations.entry(index).or_default() += 1;
            self.retain_listed(|pair, _| !pair.contains(&index));
        }
    }

    fn retain_listed(&mut self, stays: impl Fn(&Pair, u64) -> bool) {
        self.included.retain(|pair, by| stays(pair, *by));
        self.excluded.retain(|pair, by| stays(pair, *by));
    }

    pub fn clear(&mut self, range: Range<u32>) {
        range.clone().for_each(|index| self.remove(index));
        self.retain_listed(|pair, _| !pair.iter().any(|index| range.contains(index)));
    }

    fn may_meet(&self, a: u32, b: u32) -> bool {
        let [included, excluded] =
            [&self.included, &self.excluded].map(|list| list.contains_key(&[a, b]));
        self.rules_allow([&self.bodies[&a], &self.bodies[&b]], included, excluded)
    }

    /// The seven rules, in their order.
    fn rules_allow(&self, [x, y]: [&Body; 2], included: bool, excluded: bool) -> bool {
        let [f, g] = [filter(&self.filters, x), filter(&self.filters, y)];
        let (v, w) = (x.filter_data.world.0, y.filter_data.world.0);
        if v != w && v != -1 && w != -1 {
            return false;
        }
        if included {
            return true;
        }
        if x.filter_data.owner == y.filter_data.owner && x.filter_data.owner.0 != 0
            || (x.is_static || f.is_static) && (y.is_static || g.is_static)
            || excluded
        {
            return false;
        }
        if f.group == g.group && f.group != 0 {
            return f.group > 0;
        }
        let (one, other) = (f.category & g.mask != 0, g.category & f.mask != 0);
        if f.either && g.either { one || other } else { one && other }
    }

    pub fn pairs(&self) -> PairsByGeneration {
        let is_valid = |body: &Body| (0..3).all(|i| body.b.min[i] <= body.b.max[i]);
        let mut valid: Vec<(u32, Aabb)> = self
            .bodies
            .iter()
            .filter(|(_, body)| body.is_on && is_valid(body))
            .map(|(index, body)| (*index, body.b))
            .collect();
        valid.sort_by(|(_, a), (_, b)| a.min[0].partial_cmp(&b.min[0]).expect("no NaN"));
        let mut pairs = Vec::new();
        for (at, (i, a)) in valid.iter().enumerate() {
            for (j, b) in valid[at + 1..].iter().take_while(|(_, b)| b.min[0] <= a.max[0]) {
                let over = |axis: usize| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis];
                let pair = [*i.min(j), *i.max(j)];
                if over(1) && over(2) && self.may_meet(pair[0], pair[1]) {
                    pairs.push((pair, self.generations_of(pair)));
                }
            }
        }
        pairs.into_iter().collect()
    }

    /// The pairs [query, index] of queries with filter data, or none: a query has no index, so that lists say nothing of it.
    pub fn query(&self, queries: &[Aabb], filter_data: QueryFilterData<'_>) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (number, query) in queries.iter().enumerate() {
            let filter_data = match filter_data {
                QueryFilterData::None => None,
                QueryFilterData::One(filter_data) => Some(filter_data),
                QueryFilterData::Each(filter_data) => Some(filter_data[number]),
            };
            let found = self.found_by(filter_data).filter(|(_, b)| overlap(query, b));
            pairs.extend(found.map(|(index, _)| [number as u32, index]));
        }
        pairs
    }

    /// The boxes that a query with filter data, or none, may find.
    fn found_by(&self, filter_data: Option<FilterData>) -> impl Iterator<Item = (u32, Aabb)> {
        let may_find = move |(_, body): &(&u32, &Body)| {
            body.is_on
                && filter_data.is_none_or(|filter_data| {
                    let is_static = filter_data.is_static();
                    let asks = Body { is_static, filter_data, ..**body };
                    self.rules_allow([&asks, body], false, false)
                })
        };
        self.bodies.iter().filter(may_find).map(|(index, body)| (*index, body.b))
    }

    /// The same by index, with [`Aabb::EMPTY`] for all others.
    pub fn boxes_found_by(&self, filter_data: Option<FilterData>) -> Vec<Aabb> {
        let mut boxes = Vec::new();
        for (index, b) in self.found_by(filter_data) {
            boxes.resize(index as usize, Aabb::EMPTY);
            boxes.push(b);
        }
        boxes
    }

    pub fn has(&self, index: u32) -> bool {
        self.bodies.contains_key(&index)
    }

    pub fn user_data(&self, index: u32) -> u64 {
        self.user_data.get(&index).copied().unwrap_or(0)
    }

    pub fn boxes(&self) -> impl Iterator<Item = Aabb> {
        self.bodies.values().map(|body| body.b)
    }

    fn generations_of(&self, pair: Pair) -> [u32; 2] {
        pair.map(|index| self.generations.get(&index).copied().unwrap_or(0))
    }

    fn reason(&self, pair: Pair, generations: [u32; 2]) -> EndReason {
        let are_on = || pair.iter().all(|index| self.bodies[index].is_on);
        if self.generations_of(pair) != generations {
            EndReason::Removed
        } else if !are_on() || !self.may_meet(pair[0], pair[1]) {
            EndReason::Filtered
        } else {
            EndReason::Separated
        }
    }
}

/// Whether two boxes overlap: written anew, apart from the engines'.
pub fn overlap(a: &Aabb, b: &Aabb) -> bool {
    let is_valid = |b: &Aabb| (0..3).all(|axis| b.min[axis] <= b.max[axis]);
    let is_over = (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis]);
    is_valid(a) && is_valid(b) && is_over
}

fn filter(filters: &[Filter], body: &Body) -> Filter {
    filters.get(usize::from(body.filter_data.filter.0)).copied().unwrap_or(Filter::ALL)
}

fn put(list: &mut BTreeMap<Pair, u64>, [a, b]: Pair, by: Option<u64>) {
    let pair = [a.min(b), a.max(b)];
    match by {
        Some(by) => drop(list.insert(pair, by)),
        None => drop(list.remove(&pair)),
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Received {
    pub is_resync: bool,
    /// Pairs of the whole scene, where that is reported.
    pub pair_count: Option<u64>,
    pub begun: Vec<Pair>,
    pub ended: Vec<Ended>,
    pub pairs: Vec<Pair>,
}

impl Received {
    /// What it makes of the pairs that a listener knew. A change that is reported twice is a failure.
    pub fn teach(&self, known: &mut BTreeSet<Pair>) {
        if self.is_resync {
            *known = self.pairs.iter().copied().collect();
            return;
        }
        self.ended.iter().for_each(|ended| assert!(known.remove(&ended.pair), "{ended:?}"));
        self.begun.iter().for_each(|begun| assert!(known.insert(*begun), "{begun:?} began twice"));
    }
}

/// The pairs that ended, of a list or one by one.
pub fn ended(listed: impl IntoIterator<Item = impl Borrow<Ended>>) -> Vec<Ended> {
    listed.into_iter().map(|ended| *ended.borrow()).collect()
}

#[macro_export]
macro_rules! received {
    ($answer:expr) => {
        $crate::scene_model::Received {
            is_resync: $answer.is_resync(),
            pair_count: $answer.pair_count(),
            begun: $answer.begun().to_vec(),
            ended: $crate::scene_model::ended($answer.ended()),
            pairs: $answer.pairs().to_vec(),
        }
    };
}

#[derive(Clone, Debug)]
pub struct Listener {
    pub id: u64,
    then: PairsByGeneration,
    pub is_lost: bool,
    /// Boxes that were named since what moved pairs are counted from; `None`: all boxes.
    moved: Option<BTreeSet<u32>>,
    /// Whether it has acknowledged anything, and whether an edit was made since then.
    acknowledged: [bool; 2],
    /// It learns of pairs that touch these indices; `None`: of all.
    pub own: Option<Range<u32>>,
}

impl Listener {
    /// One that knows that there is no pair, or nothing.
    pub const fn new(id: u64, is_lost: bool, own: Option<Range<u32>>) -> Self {
        Self { id, then: BTreeMap::new(), is_lost, moved: None, acknowledged: [false; 2], own }
    }

    /// An edit has been made.
    pub const fn note_edit(&mut self) {
        self.acknowledged[1] = true;
    }

    /// Whether it acknowledged an answer, and an edit was made since then.
    pub fn is_behind(&self) -> bool {
        self.acknowledged == [true; 2]
    }

    /// An edit has named some boxes: its own, of a scene that is not shared, whose moved pairs are those of one edit.
    pub fn note_named(&mut self, named: &BTreeSet<u32>, is_shared: bool) {
        if !is_shared {
            self.moved = Some(named.clone());
        } else if let Some(moved) = &mut self.moved {
            moved.extend(named);
        }
    }

    fn scope(&self, pairs: &PairsByGeneration) -> PairsByGeneration {
        let is_own = |index: &u32| self.own.as_ref().is_none_or(|own| own.contains(index));
        let received = pairs.iter().filter(|(pair, _)| pair.iter().any(is_own));
        received.map(|(pair, generations)| (*pair, *generations)).collect()
    }

    /// What is to be reported to it of the pairs of now.
    pub fn expects(&self, model: &Model, now: &PairsByGeneration, mode: Mode) -> Received {
        let pair_count = Some(now.len() as u64);
        let received = self.scope(now);
        let all = || received.keys().copied().collect::<Vec<Pair>>();
        match mode {
            Mode::Changes => {
                let begun = received.iter().filter(|(pair, of)| self.then.get(*pair) != Some(*of));
                let ended = self.then.iter().filter(|(pair, of)| received.get(*pair) != Some(*of));
                let (begun, ended): (Vec<_>, Vec<_>) = (begun.collect(), ended.collect());
                let most = now.len().max(RESYNC_LEAST);
                if self.is_lost || begun.len() + ended.len() > most {
                    return Received {
                        is_resync: true,
                        pair_count,
                        pairs: all(),
                        ..Received::default()
                    };
                }
                let begun = begun.into_iter().map(|(pair, _)| *pair).collect();
                let reason = |(pair, of): (&Pair, &[u32; 2])| Ended {
                    pair: *pair,
                    reason: model.reason(*pair, *of),
                };
                let ended = ended.into_iter().map(reason).collect();
                Received { pair_count, begun, ended, ..Received::default() }
            }
            Mode::All => Received { pair_count, pairs: all(), ..Received::default() },
            Mode::Moved => {
                let has_moved = |index: &u32| self.moved.as_ref().is_none_or(|m| m.contains(index));
                let pairs = received.keys().copied().filter(|pair| pair.iter().any(has_moved));
                let pairs = pairs.collect();
                Received { pairs, ..Received::default() }
            }
            _ => Received::default(),
        }
    }

    /// It acknowledges an answer that reported the pairs of now.
    pub fn acknowledge(&mut self, now: &PairsByGeneration, mode: Mode) {
        self.moved = Some(BTreeSet::new());
        if matches!(mode, Mode::Changes | Mode::All) {
            (self.then, self.is_lost) = (self.scope(now), false);
            self.acknowledged = [true, false];
        }
    }
}
