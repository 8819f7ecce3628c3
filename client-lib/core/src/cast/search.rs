//! The hits of one question, from the whole tree down.

use std::cmp::Ordering;

use super::exact::ERROR;
use super::node::{FAN_OUT, Keys, Leaf, MISSED, Node, key_limit, take_nearest};
use super::probe::Probe;
use super::tree::BoxTree;
use super::{Hit, Hits, hittable};
use crate::aabb::Aabb;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// So many of the closest are kept in order as they are found; of more, twice as many are, before the farther half goes.
const FEW_CLOSEST: usize = 32;

/// Searches that go down a tree in turns: what each asks for comes while the others are at work. Their groups and keys stay
/// in the first-level cache.
pub(super) const TOGETHER: usize = 8;

/// Levels above the leaves of 2^32 boxes.
const MOST_LEVELS: usize = 7;

/// A box that is hit.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    /// Its distance as the probe measures it.
    distance: f64,
    pub reported: f32,
    pub index: u32,
}

impl Candidate {
    const ANY: Self = Self { distance: 0.0, reported: 0.0, index: Hit::ANY };
}

/// Where the hits of one question are searched for.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    Tree(&'a BoxTree),
    Boxes(&'a [Aabb]),
    /// Found by their places, and not by their indices.
    Candidates(&'a [(u32, Aabb)]),
}

/// What all questions of a cast have in common.
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub place: Place<'a>,
    pub hits: Hits,
    /// One more than all questions together may have.
    pub room: usize,
    pub isa: AvailableIsa,
    /// Whether a question, by its number, may hit a box.
    pub admits: &'a dyn Fn(u32, u32) -> bool,
}

impl Common<'_> {
    /// How many questions to search for at a time: one, where nothing is asked for ahead, or where each has memory for twice
    /// as many hits as are wanted.
    pub const fn together(&self) -> usize {
        match (self.place, self.hits) {
            (Place::Boxes(_) | Place::Candidates(_), _) => 1,
            (_, Hits::Closest(most)) if most as usize > FEW_CLOSEST => 1,
            (Place::Tree(_), Hits::All | Hits::Closest(_) | Hits::Any) => TOGETHER,
        }
    }
}

/// The search for the hits of one question.
pub(super) struct Search<'a, P> {
    common: Common<'a>,
    pub query: u32,
    probe: P,
    /// Up to where boxes are looked for.
    limit: f32,
    /// What was found: in order when the search has ended.
    pub found: Vec<Candidate>,
    pub looked_at: u64,
    descent: Descent,
}

/// Where a search stands in a tree.
struct Descent {
    /// What is looked at next: a leaf at depth 0, else a group of the level below that.
    depth: usize,
    next: usize,
    /// Of the group of each level that is being looked at: its number, and keys of its own groups.
    numbers: [usize; MOST_LEVELS],
    keys: [Keys; MOST_LEVELS],
}

impl Place<'_> {
    fn get(&self, index: u32) -> Aabb {
        match self {
            Self::Tree(tree) => tree.get(index),
            Self::Boxes(boxes) => boxes[index as usize],
            Self::Candidates(some) => some[index as usize].1,
        }
    }
}

impl<'a, P: Probe> Search<'a, P> {
    /// A search that has not begun. `found` is memory for what it finds.
    pub fn new(common: Common<'a>, query: u32, probe: P, mut found: Vec<Candidate>) -> Self {
        found.clear();
        let depth = match common.place {
            Place::Tree(tree) => tree.levels().len(),
            Place::Boxes(_) | Place::Candidates(_) => 0,
        };
        let (numbers, keys) = ([0; MOST_LEVELS], [[MISSED; FAN_OUT]; MOST_LEVELS]);
        let descent = Descent { depth, next: 0, numbers, keys };
        let limit = probe.most();
        Self { common, query, probe, limit, found, looked_at: 0, descent }
    }

    /// Finds the hits of some questions, in turns; those of each are in order then.
    ///
    /// # Panics
    /// With more than [`TOGETHER`].
    pub fn run(searches: &mut [Self]) {
        let Some(Common { place, hits, room, isa, .. }) =
            searches.first().map(|first| first.common)
        else {
            return;
        };
        if hits == Hits::Closest(0) {
            return;
        }
        match place {
            Place::Tree(tree) => descend(searches, tree, room, isa),
            Place::Boxes(boxes) => {
                for search in &mut *searches {
                    pass_through(search, boxes, isa);
                }
            }
            Place::Candidates(some) => {
                for search in &mut *searches {
                    search.decide(some);
                }
            }
        }
        for Self { found, probe, .. } in searches {
            match hits {
                Hits::All => found.sort_unstable_by(|a, b| compare(a, b, probe, &place)),
                Hits::Closest(most) if most as usize > FEW_CLOSEST => {
                    found.sort_unstable_by(|a, b| compare(a, b, probe, &place));
                    found.truncate(most as usize);
                }
                Hits::Closest(_) | Hits::Any => {}
            }
        }
    }

    /// Looks at what was asked for, and asks for what comes next, the nearest first. Whether there is any.
    #[inline(always)]
    fn step(&mut self, tree: &BoxTree) -> bool {
        let (leaves, levels) = (tree.leaves(), tree.levels());
        let mut at = 0;
        if self.descent.depth == 0 {
            let leaf = leaves.get(self.descent.next);
            if leaf.is_none_or(|leaf| !self.look_at(leaf)) || levels.is_empty() {
                return false;
            }
        } else {
            at = self.descent.depth - 1;
            self.look_at_group(levels, at, self.descent.next);
        }
        let limit = key_limit(self.limit);
        loop {
            let (nearest, lane) = take_nearest(&mut self.descent.keys[at]);
            if nearest == MISSED || nearest > limit {
                at += 1;
                if at == levels.len() {
                    return false;
                }
                continue;
            }
            // Bounds hold nothing where there are no more groups, but a limit may be infinite.
            let number = self.descent.numbers[at] * FAN_OUT + lane;
            let is_there = match at.checked_sub(1) {
                None => leaves.get(number).map(Leaf::ask_for),
                Some(0) => levels[0].get(number).map(Node::ask_for),
                Some(below) => {
                    // The upper levels are small, and near at all times.
                    if number < levels[below].len() {
                        at = below;
                        self.look_at_group(levels, at, number);
                    }
                    continue;
                }
            };
            if is_there.is_some() {
                (self.descent.depth, self.descent.next) = (at, number);
                return true;
            }
        }
    }

    #[inline(always)]
    fn look_at_group(&mut self, levels: &[Vec<Node>], at: usize, number: usize) {
        self.descent.numbers[at] = number;
        self.probe.keys(&levels[at][number], self.limit, &mut self.descent.keys[at]);
    }

    /// Looks at the boxes of a leaf, the nearest first. Whether to go on.
    #[inline(always)]
    fn look_at(&mut self, leaf: &Leaf) -> bool {
        let mut keys = [MISSED; FAN_OUT];
        self.probe.keys(&leaf.boxes, self.limit, &mut keys);
        self.looked_at += FAN_OUT as u64;
        loop {
            let (nearest, lane) = take_nearest(&mut keys);
            if nearest == MISSED || nearest > key_limit(self.limit) {
                return true;
            }
            if let Some(distance) = self.probe.measure(&leaf.boxes.get(lane))
                && !self.offer(leaf.indices[lane], distance)
            {
                return false;
            }
        }
    }

    /// Looks at boxes that are few.
    fn decide(&mut self, some: &[(u32, Aabb)]) {
        self.looked_at += some.len() as u64;
        for (at, (_, b)) in (0..).zip(some) {
            if let Some(distance) = self.probe.measure(&hittable(b))
                && !self.offer(at, distance)
            {
                return;
            }
        }
    }

    /// Offers a box that is hit. Whether to go on.
    fn offer(&mut self, index: u32, distance: f64) -> bool {
        let Self { common, query, probe, limit, found, .. } = self;
        let Common { place, hits, room, .. } = *common;
        let candidate = Candidate { distance, reported: probe.reported(distance), index };
        let admits = |index| (common.admits)(*query, index);
        let by_distance = |a: &Candidate, b: &Candidate| compare(a, b, probe, &place);
        match hits {
            Hits::Any => {
                let is_hit = admits(index);
                if is_hit {
                    found.push(Candidate::ANY);
                }
                !is_hit
            }
            Hits::All => {
                if admits(index) {
                    found.push(candidate);
                }
                found.len() < room
            }
            Hits::Closest(most) if most as usize <= FEW_CLOSEST => {
                let most = most as usize;
                let is_late = |last| by_distance(&candidate, last).is_gt();
                let is_full = found.len() == most;
                if is_full && found.last().is_none_or(is_late) || !admits(index) {
                    return true;
                }
                found.truncate(most - 1);
                let mut at = found.len();
                found.push(candidate);
                while at > 0 && by_distance(&candidate, &found[at - 1]).is_lt() {
                    found[at] = found[at - 1];
                    at -= 1;
                }
                found[at] = candidate;
                if let Some(last) = found.get(most - 1) {
                    *limit = limit.min(probe.limit_of(last.distance));
                }
                true
            }
            Hits::Closest(most) => {
                let most = most as usize;
                if admits(index) {
                    found.push(candidate);
                }
                if found.len() >= 2 * most {
                    let (_, last, _) = found.select_nth_unstable_by(most - 1, by_distance);
                    *limit = limit.min(probe.limit_of(last.distance));
                    found.truncate(most);
                }
                // More than there is room for at the end, not on the way.
                most < room || found.len() < room
            }
        }
    }
}

/// By exact distance, and then by index.
fn compare<P: Probe>(a: &Candidate, b: &Candidate, probe: &P, place: &Place<'_>) -> Ordering {
    let by_distance = if (a.distance - b.distance).abs() > ERROR * a.distance.max(b.distance) {
        a.distance.total_cmp(&b.distance)
    } else if a.distance == 0.0 && b.distance == 0.0 {
        // Zeros are exact.
        Ordering::Equal
    } else {
        probe.compare(&place.get(a.index), &place.get(b.index))
    };
    by_distance.then(a.index.cmp(&b.index))
}

per_isa! {
    /// Goes down a tree with some searches in turns, so that each has the time to come of what it asked for.
    fn descend<simd: S, P: Probe>(searches: &mut [Search<'_, P>], tree: &BoxTree, room: usize) {
        let _ = simd;
        let mut under_way: [usize; TOGETHER] = std::array::from_fn(|at| at);
        let mut count = searches.len();
        while count > 0 {
            let mut turn = 0;
            while turn < count {
                let search = &mut searches[under_way[turn]];
                if search.step(tree) {
                    turn += 1;
                } else {
                    count -= 1;
                    under_way[turn] = under_way[count];
                }
            }
            // More than all questions together may have: what is left of the searches is not needed.
            if searches.len() > 1 && searches.iter().map(|of| of.found.len()).sum::<usize>() >= room {
                return;
            }
        }
    }
}

per_isa! {
    /// Looks at all boxes.
    fn pass_through<simd: S, P: Probe>(search: &mut Search<'_, P>, boxes: &[Aabb]) {
        let _ = simd;
        for (first, some) in (0u32..).step_by(FAN_OUT).zip(boxes.chunks(FAN_OUT)) {
            let mut leaf = Leaf::NOTHING;
            for (lane, b) in some.iter().enumerate() {
                leaf.boxes.set(lane, &hittable(b));
                leaf.indices[lane] = first + lane as u32;
            }
            if !search.look_at(&leaf) {
                return;
            }
        }
    }
}
