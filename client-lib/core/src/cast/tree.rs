//! Boxes in groups of 16, those in groups of 16, and so on up to one. The boxes of a group lie near each other when the
//! tree is built. Then groups grow and shrink with their boxes, until too many have become too large.

use super::hittable;
use super::node::{FAN_OUT, Leaf, NOTHING, Node};
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::engine::{AvailableIsa, order_by_tree};
use crate::floats;
use crate::huge_pages;
use crate::team::{self, for_each_in_parts, part_count};

/// Leaves that a task fills at least.
const TASK_LEAVES: usize = 256;
/// A leaf is loose when its bounds are so many times as large as when the tree was built.
const LOOSE: f64 = 4.0;
/// The tree is built anew when more than one leaf in so many is loose, or searches would have looked at so many boxes of loose
/// leaves for each box, were they to meet all of these: about as long as to build it takes.
const LOOSE_SHARE: usize = 4;
const LOOSE_LOOKS: u64 = 64;
/// The index of a lane without a box.
const NOBODY: u32 = u32::MAX;
/// Edges are not taken for longer than this.
const LONGEST: f32 = 1e37;

/// Boxes in a tree, for casts.
#[derive(Debug, Default)]
pub struct BoxTree {
    leaves: Vec<Leaf>,
    /// Bounds of 16 leaves each, then of 16 of those, and so on; the last has one node. None for a single leaf.
    levels: Vec<Vec<Node>>,
    /// Place of each index: leaf times 16 and lane.
    places: Vec<u32>,
    /// The first place that was never given to an index.
    next: usize,
    /// Size of each leaf's bounds when it was built; below 0 for one that is loose.
    built: Vec<f64>,
    loose: usize,
    /// Boxes of loose leaves that searches would have looked at.
    loose_looks: u64,
    /// Largest finite coordinate that was ever there, as a magnitude.
    reach: f32,
    /// Groups whose bounds are to be found anew.
    touched: Vec<u32>,
}

/// Half the surface of bounds, by which boxes meet them; with a little for those that are flat, or a line.
fn size(b: &Aabb) -> f64 {
    const LITTLE: f64 = 1.0 / 65_536.0;
    let [x, y, z] =
        [0, 1, 2].map(|axis| f64::from((b.max[axis] - b.min[axis]).clamp(0.0, LONGEST)));
    x * y + y * z + z * x + LITTLE * (x + y + z) * (x + y + z)
}

fn reach_of(b: &Aabb) -> f32 {
    let of = |reach: f32, x: &f32| if x.is_finite() { reach.max(x.abs()) } else { reach };
    b.min.iter().chain(&b.max).fold(0.0, of)
}

/// Indices of all boxes in an order in which any 16 that follow one another lie near each other: that of a [`BoxTree`].
pub fn near_order(boxes: &[Aabb], threads: usize) -> Vec<u32> {
    let _team = team::enter(threads);
    let entries = order_by_tree(boxes, threads, AvailableIsa::best(), &Cancel::never());
    entries.as_slice().iter().map(|entry| entry.index).collect()
}

impl BoxTree {
    /// A tree of boxes: index i is box i.
    pub fn of(boxes: &[Aabb], threads: usize) -> Self {
        let mut tree = Self::default();
        tree.build(boxes, threads, &Cancel::never());
        tree
    }

    /// The same, unless cancelled.
    pub(crate) fn unless(cancel: &Cancel, boxes: &[Aabb], threads: usize) -> Option<Self> {
        let mut tree = Self::default();
        tree.build(boxes, threads, cancel).then_some(tree)
    }

    /// Places all boxes. Whether it was not cancelled, which leaves the tree as it was.
    fn build(&mut self, boxes: &[Aabb], threads: usize, cancel: &Cancel) -> bool {
        let _team = team::enter(threads);
        let entries = order_by_tree(boxes, threads, AvailableIsa::best(), cancel);
        if cancel.is_cancelled() {
            return false;
        }
        let entries = entries.as_slice();
        let leaves = entries.len().div_ceil(FAN_OUT).max(1);
        if leaves > self.leaves.capacity() {
            self.leaves = Vec::with_capacity(leaves);
            huge_pages::prefer(&self.leaves);
        }
        self.leaves.clear();
        self.leaves.resize(leaves, Leaf::NOTHING);
        let parts = part_count(self.leaves.len(), TASK_LEAVES, threads);
        let step = self.leaves.len().div_ceil(parts).max(1);
        let some = entries.chunks(step * FAN_OUT);
        let mut work: Vec<_> = self.leaves.chunks_mut(step).zip(some).collect();
        for_each_in_parts(&mut work, parts, |(leaves, entries)| {
            for (leaf, entries) in leaves.iter_mut().zip(entries.chunks(FAN_OUT)) {
                for (lane, entry) in entries.iter().enumerate() {
                    leaf.boxes.set(lane, &hittable(&entry.aabb));
                    leaf.indices[lane] = entry.index;
                }
            }
        });
        self.places.clear();
        self.places.resize(entries.len(), 0);
        self.next = entries.len();
        for (place, entry) in (0..).zip(entries) {
            self.places[entry.index as usize] = place;
        }
        self.levels.clear();
        let mut groups = self.leaves.len();
        while groups > 1 {
            groups = groups.div_ceil(FAN_OUT);
            self.levels.push(vec![Node::NOTHING; groups]);
        }
        (self.loose, self.loose_looks) = (0, 0);
        self.built.clear();
        floats::with_default(|| {
            self.built.extend(self.leaves.iter().map(|leaf| size(&leaf.boxes.bounds())));
            self.bound_all();
            self.reach = reach_of(&self.bounds());
        });
        true
    }

    /// Indices that it has a place for.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let nodes: usize = self.levels.iter().map(Vec::capacity).sum();
        self.leaves.capacity() * size_of::<Leaf>()
            + nodes * size_of::<Node>()
            + (self.places.capacity() + self.touched.capacity()) * size_of::<u32>()
            + self.built.capacity() * size_of::<f64>()
    }

    /// Brings boxes to where they are now: those of some indices, or all. An index that is not among the boxes has none
    /// any more.
    pub fn update(&mut self, boxes: &[Aabb], changed: Option<&[u32]>, threads: usize) {
        let _team = team::enter(threads);
        while self.places.len() < boxes.len() {
            let place = self.append(self.places.len() as u32);
            self.places.push(place);
        }
        match changed {
            Some(changed) if changed.len() <= boxes.len() / FAN_OUT => floats::with_default(|| {
                for index in changed {
                    self.put(boxes, *index);
                }
                self.bound_touched();
            }),
            _ => self.put_all(boxes, threads),
        }
        if self.is_costly() || self.loose * LOOSE_SHARE > self.leaves.len() {
            self.build(boxes, threads, &Cancel::never());
        }
    }

    /// Whether loose leaves cost as much as to build the tree anew, which an update does.
    pub(crate) const fn is_costly(&self) -> bool {
        self.loose_looks > LOOSE_LOOKS * self.places.len() as u64
    }

    /// Notes that so many searches are to follow.
    pub(crate) const fn note_searches(&mut self, count: usize) {
        let looks = (FAN_OUT as u64 * self.loose as u64).saturating_mul(count as u64);
        self.loose_looks = self.loose_looks.saturating_add(looks);
    }

    /// Adds a place for an index.
    fn append(&mut self, index: u32) -> u32 {
        let place = self.next;
        self.next += 1;
        if place == FAN_OUT * self.leaves.len() {
            self.leaves.push(Leaf::NOTHING);
            self.built.push(-1.0);
            self.loose += 1;
            self.grow();
        }
        self.leaves[place / FAN_OUT].indices[place % FAN_OUT] = index;
        place as u32
    }

    fn put(&mut self, boxes: &[Aabb], index: u32) {
        let Some(place) = self.places.get(index as usize) else { return };
        let mut place = *place as usize;
        let b = boxes.get(index as usize).map_or(NOTHING, hittable);
        if self.would_loosen(place / FAN_OUT, &b) {
            // It leaves the others, so that those that went far are together in a few leaves.
            self.set(place, &NOTHING);
            self.leaves[place / FAN_OUT].indices[place % FAN_OUT] = NOBODY;
            let new = self.append(index);
            self.places[index as usize] = new;
            place = new as usize;
        }
        self.set(place, &b);
        self.reach = self.reach.max(reach_of(&b));
    }

    fn set(&mut self, place: usize, b: &Aabb) {
        self.leaves[place / FAN_OUT].boxes.set(place % FAN_OUT, b);
        self.touched.push((place / FAN_OUT) as u32);
    }

    /// Whether a leaf that is not loose would be with a box.
    fn would_loosen(&self, leaf: usize, b: &Aabb) -> bool {
        let built = self.built[leaf];
        let Aabb { min, max } = self.leaves[leaf].boxes.bounds();
        let with = Aabb {
            min: std::array::from_fn(|axis| min[axis].min(b.min[axis])),
            max: std::array::from_fn(|axis| max[axis].max(b.max[axis])),
        };
        built >= 0.0 && size(&with) > LOOSE * built
    }

    fn put_all(&mut self, boxes: &[Aabb], threads: usize) {
        let parts = part_count(self.leaves.len(), TASK_LEAVES, threads);
        let step = self.leaves.len().div_ceil(parts).max(1);
        let mut work: Vec<&mut [Leaf]> = self.leaves.chunks_mut(step).collect();
        for_each_in_parts(&mut work, parts, |leaves| {
            for Leaf { boxes: of_leaf, indices } in leaves.iter_mut() {
                for (lane, index) in indices.iter().enumerate() {
                    // None of a lane without a box.
                    let b = boxes.get(*index as usize);
                    of_leaf.set(lane, &b.map_or(NOTHING, hittable));
                }
            }
        });
        self.touched.clear();
        floats::with_default(|| {
            for leaf in 0..self.leaves.len() {
                self.note_size(leaf);
            }
            self.bound_all();
            self.reach = self.reach.max(reach_of(&self.bounds()));
        });
    }

    /// Adds groups for a new leaf.
    fn grow(&mut self) {
        let mut groups = self.leaves.len();
        for at in 0.. {
            if groups == 1 {
                break;
            }
            groups = groups.div_ceil(FAN_OUT);
            if let Some(level) = self.levels.get_mut(at) {
                level.resize(groups, Node::NOTHING);
            } else {
                self.levels.push(vec![Node::NOTHING; groups]);
                // A level that begins holds the bounds of what was the whole.
                let whole = self.bounds_of(at, 0);
                self.levels[at][0].set(0, &whole);
            }
        }
    }

    /// Bounds of a group: of a leaf at depth 0, else of a node of the level below.
    fn bounds_of(&self, depth: usize, group: usize) -> Aabb {
        match depth.checked_sub(1) {
            None => self.leaves[group].boxes.bounds(),
            Some(level) => self.levels[level][group].bounds(),
        }
    }

    /// A box around all.
    pub fn bounds(&self) -> Aabb {
        match self.levels.len() {
            0 if self.leaves.is_empty() => Aabb::EMPTY,
            depth => self.bounds_of(depth, 0),
        }
    }

    fn note_size(&mut self, leaf: usize) {
        let built = self.built[leaf];
        if built >= 0.0 && size(&self.leaves[leaf].boxes.bounds()) > LOOSE * built {
            self.built[leaf] = -1.0;
            self.loose += 1;
        }
    }

    fn bound_all(&mut self) {
        for depth in 0..self.levels.len() {
            let groups = if depth == 0 { self.leaves.len() } else { self.levels[depth - 1].len() };
            for group in 0..groups {
                let bounds = self.bounds_of(depth, group);
                self.levels[depth][group / FAN_OUT].set(group % FAN_OUT, &bounds);
            }
        }
    }

    fn bound_touched(&mut self) {
        let mut touched = std::mem::take(&mut self.touched);
        for depth in 0..=self.levels.len() {
            touched.sort_unstable();
            touched.dedup();
            for group in &mut touched {
                let at = *group as usize;
                if depth == 0 {
                    self.note_size(at);
                }
                if depth < self.levels.len() {
                    let bounds = self.bounds_of(depth, at);
                    self.levels[depth][at / FAN_OUT].set(at % FAN_OUT, &bounds);
                }
                *group /= FAN_OUT as u32;
            }
        }
        touched.clear();
        self.touched = touched;
    }

    /// The box of an index that has a place.
    pub(super) fn get(&self, index: u32) -> Aabb {
        let place = self.places[index as usize] as usize;
        self.leaves[place / FAN_OUT].boxes.get(place % FAN_OUT)
    }

    pub(super) fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    pub(super) fn levels(&self) -> &[Vec<Node>] {
        &self.levels
    }

    /// Largest magnitude of a finite coordinate, or more.
    pub(super) const fn reach(&self) -> f32 {
        self.reach
    }
}
