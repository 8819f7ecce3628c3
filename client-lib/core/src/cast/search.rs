//! The hits of one question, from the whole tree down.

use std::cmp::Ordering;

use super::exact::ERROR;
use super::node::{FAN_OUT, Leaf, MISSED, key_limit, take_nearest};
use super::probe::Probe;
use super::tree::BoxTree;
use super::{Hit, Hits, hittable};
use crate::aabb::Aabb;
use crate::engine::AvailableIsa;
use crate::simd::per_isa;

/// So many of the closest are kept in order as they are found; of more, twice as many are, before the farther half goes.
const FEW_CLOSEST: usize = 32;

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

/// A search, with the memory of those before it.
pub(super) struct Search<'a> {
    pub place: Place<'a>,
    pub hits: Hits,
    /// Most hits of a question.
    pub room: usize,
    pub isa: AvailableIsa,
    /// What was found: in order when the search has ended.
    pub found: Vec<Candidate>,
    pub looked_at: u64,
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

impl Search<'_> {
    /// Finds the hits, which are in order then.
    pub fn run<P: Probe>(&mut self, probe: &P, admits: &dyn Fn(u32) -> bool) {
        if self.hits == Hits::Closest(0) {
            return;
        }
        let mut limit = probe.most();
        match self.place {
            Place::Tree(tree) => descend(self, tree, probe, admits, &mut limit, self.isa),
            Place::Boxes(boxes) => pass_through(self, boxes, probe, admits, &mut limit, self.isa),
            Place::Candidates(some) => self.decide(some, probe, admits, &mut limit),
        }
        let place = self.place;
        match self.hits {
            Hits::All => self.found.sort_unstable_by(|a, b| compare(a, b, probe, &place)),
            Hits::Closest(most) if most as usize > FEW_CLOSEST => {
                self.found.sort_unstable_by(|a, b| compare(a, b, probe, &place));
                self.found.truncate(most as usize);
            }
            Hits::Closest(_) | Hits::Any => {}
        }
    }

    /// Looks at the boxes of a leaf, the nearest first. Whether to go on.
    #[inline(always)]
    fn look_at<P: Probe>(
        &mut self,
        leaf: &Leaf,
        probe: &P,
        admits: &dyn Fn(u32) -> bool,
        limit: &mut f32,
    ) -> bool {
        let mut keys = [MISSED; FAN_OUT];
        probe.keys(&leaf.boxes, *limit, &mut keys);
        self.looked_at += FAN_OUT as u64;
        loop {
            let (nearest, lane) = take_nearest(&mut keys);
            if nearest == MISSED || nearest > key_limit(*limit) {
                return true;
            }
            if let Some(distance) = probe.measure(&leaf.boxes.get(lane))
                && !self.offer(leaf.indices[lane], distance, probe, admits, limit)
            {
                return false;
            }
        }
    }

    /// Looks at boxes that are few.
    fn decide<P: Probe>(
        &mut self,
        some: &[(u32, Aabb)],
        probe: &P,
        admits: &dyn Fn(u32) -> bool,
        limit: &mut f32,
    ) {
        self.looked_at += some.len() as u64;
        for (at, (_, b)) in (0..).zip(some) {
            if let Some(distance) = probe.measure(&hittable(b))
                && !self.offer(at, distance, probe, admits, limit)
            {
                return;
            }
        }
    }

    /// Offers a box that is hit. Whether to go on.
    fn offer<P: Probe>(
        &mut self,
        index: u32,
        distance: f64,
        probe: &P,
        admits: &dyn Fn(u32) -> bool,
        limit: &mut f32,
    ) -> bool {
        let candidate = Candidate { distance, reported: probe.reported(distance), index };
        let place = self.place;
        let by_distance = |a: &Candidate, b: &Candidate| compare(a, b, probe, &place);
        match self.hits {
            Hits::Any => {
                let is_hit = admits(index);
                if is_hit {
                    self.found.push(Candidate::ANY);
                }
                !is_hit
            }
            Hits::All => {
                if admits(index) {
                    self.found.push(candidate);
                }
                self.found.len() < self.room
            }
            Hits::Closest(most) if most as usize <= FEW_CLOSEST => {
                let most = most as usize;
                let is_late = |last| by_distance(&candidate, last).is_gt();
                let is_full = self.found.len() == most;
                if is_full && self.found.last().is_none_or(is_late) || !admits(index) {
                    return true;
                }
                self.found.truncate(most - 1);
                let mut at = self.found.len();
                self.found.push(candidate);
                while at > 0 && by_distance(&candidate, &self.found[at - 1]).is_lt() {
                    self.found[at] = self.found[at - 1];
                    at -= 1;
                }
                self.found[at] = candidate;
                if let Some(last) = self.found.get(most - 1) {
                    *limit = limit.min(probe.limit_of(last.distance));
                }
                true
            }
            Hits::Closest(most) => {
                let most = most as usize;
                if admits(index) {
                    self.found.push(candidate);
                }
                if self.found.len() >= 2 * most {
                    let (_, last, _) = self.found.select_nth_unstable_by(most - 1, by_distance);
                    *limit = limit.min(probe.limit_of(last.distance));
                    self.found.truncate(most);
                }
                // More than there is room for at the end, not on the way.
                most < self.room || self.found.len() < self.room
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
    /// Goes down a tree, the nearest group first.
    fn descend<simd: S, P: Probe>(
        search: &mut Search<'_>,
        tree: &BoxTree,
        probe: &P,
        admits: &dyn Fn(u32) -> bool,
        limit: &mut f32,
    ) {
        let _ = simd;
        let (leaves, levels) = (tree.leaves(), tree.levels());
        let top = levels.len();
        if top == 0 {
            if let Some(leaf) = leaves.first() {
                search.look_at(leaf, probe, admits, limit);
            }
            return;
        }
        // Of the group of each level that is being looked at: its number, and keys of its own groups.
        let mut numbers = [0; MOST_LEVELS];
        let mut keys = [[MISSED; FAN_OUT]; MOST_LEVELS];
        let mut at = top - 1;
        probe.keys(&levels[at][0], *limit, &mut keys[at]);
        loop {
            let (nearest, lane) = take_nearest(&mut keys[at]);
            if nearest == MISSED || nearest > key_limit(*limit) {
                at += 1;
                if at == top {
                    return;
                }
                continue;
            }
            let number = numbers[at] * FAN_OUT + lane;
            if at == 0 {
                // Bounds hold nothing where there are no more groups, but a limit may be infinite.
                if let Some(leaf) = leaves.get(number)
                    && !search.look_at(leaf, probe, admits, limit)
                {
                    return;
                }
            } else if let Some(node) = levels[at - 1].get(number) {
                at -= 1;
                numbers[at] = number;
                probe.keys(node, *limit, &mut keys[at]);
            }
        }
    }
}

per_isa! {
    /// Looks at all boxes.
    fn pass_through<simd: S, P: Probe>(
        search: &mut Search<'_>,
        boxes: &[Aabb],
        probe: &P,
        admits: &dyn Fn(u32) -> bool,
        limit: &mut f32,
    ) {
        let _ = simd;
        for (first, some) in (0u32..).step_by(FAN_OUT).zip(boxes.chunks(FAN_OUT)) {
            let mut leaf = Leaf::NOTHING;
            for (lane, b) in some.iter().enumerate() {
                leaf.boxes.set(lane, &hittable(b));
                leaf.indices[lane] = first + lane as u32;
            }
            if !search.look_at(&leaf, probe, admits, limit) {
                return;
            }
        }
    }
}
