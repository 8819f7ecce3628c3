//! Boxes of all machines of a view as of one tick, each with what it was the tick before, and the pairs between machines.

use std::collections::HashMap;

use pairmask_core::Aabb;
use pairmask_core::engine::CullError;
use pairmask_core::scene::between;

use crate::ids::{BoxId, MachineId, PairId, pair_of};
use crate::protocol::Edits;
use crate::state::BoxState;

/// Most pairs between machines that one bridge looks at: 512 MiB of them.
const MOST_PAIRS: u64 = 1 << 26;

#[derive(Debug)]
struct Kept {
    incarnation: u32,
    now: BoxState,
    /// What it was before the tick at which it changed last.
    before: Option<BoxState>,
    changed_at: u64,
    /// Out of sight: it is kept for the one tick that decides about its pairs.
    has_left: bool,
}

/// The boxes.
#[derive(Debug, Default)]
pub struct Replica {
    boxes: HashMap<MachineId, HashMap<u32, Kept>>,
    left: Vec<(MachineId, u32)>,
    /// The tick of which it is.
    tick: u64,
}

impl Replica {
    /// Goes on to a tick. Its edits follow.
    pub fn begin(&mut self, tick: u64) {
        self.tick = tick;
        for (machine, index) in self.left.drain(..) {
            // A box that has come back is there.
            if let Some(boxes) = self.boxes.get_mut(&machine)
                && boxes.get(&index).is_some_and(|kept| kept.has_left)
            {
                boxes.remove(&index);
            }
        }
    }

    /// Applies a machine's edits of the tick.
    pub fn apply(&mut self, machine: MachineId, edits: &Edits) {
        let Self { boxes, left, tick } = self;
        let (boxes, changed_at) = (boxes.entry(machine).or_default(), *tick);
        for (index, aabb) in &edits.moved {
            if let Some(kept) = boxes.get_mut(index) {
                let before = Some(kept.now);
                kept.now.aabb = *aabb;
                (kept.before, kept.changed_at) = (before, changed_at);
            }
        }
        for entered in &edits.entered {
            let incarnation = entered.incarnation;
            let known = boxes.get(&entered.index).filter(|kept| kept.incarnation == incarnation);
            let before = known.map(|kept| kept.now).or(entered.before);
            let kept =
                Kept { incarnation, now: entered.state, before, changed_at, has_left: false };
            boxes.insert(entered.index, kept);
        }
        for (index, state) in &edits.left {
            if let Some(kept) = boxes.get_mut(index) {
                let before = Some(kept.now);
                *kept = Kept { now: *state, before, changed_at, has_left: true, ..*kept };
                left.push((machine, *index));
            }
        }
        for index in &edits.removed {
            boxes.remove(index);
        }
    }

    /// Drops a machine and its boxes.
    pub fn drop_machine(&mut self, machine: MachineId) {
        self.boxes.remove(&machine);
    }

    fn get(&self, id: BoxId) -> Option<&Kept> {
        let kept = self.boxes.get(&id.machine)?.get(&id.index)?;
        (kept.incarnation == id.incarnation).then_some(kept)
    }

    /// What a box is.
    pub fn now(&self, id: BoxId) -> Option<BoxState> {
        self.get(id).map(|kept| kept.now)
    }

    /// What a box was the tick before.
    pub fn before(&self, id: BoxId) -> Option<BoxState> {
        let kept = self.get(id)?;
        if kept.changed_at == self.tick { kept.before } else { Some(kept.now) }
    }

    /// All pairs between machines, each with the lower corner of its intersection on an axis. Boxes of one machine are no
    /// pair here: its own scene has those.
    ///
    /// # Errors
    /// [`CullError`], where there are too many.
    pub fn pairs(&self, axis: usize) -> Result<Vec<(PairId, f32)>, CullError> {
        // The largest set last: no set but the first is placed in cells more than once.
        let mut sets: Vec<Set> = self.boxes.iter().map(|(of, boxes)| Set::of(*of, boxes)).collect();
        sets.retain(|set| !set.ids.is_empty());
        sets.sort_unstable_by_key(|set| (set.ids.len(), set.ids[0]));
        let (mut pairs, mut found) = (Vec::new(), Vec::new());
        let mut others = Set::default();
        for set in sets {
            found.clear();
            between(&others.boxes, &set.boxes, Some(1), MOST_PAIRS, &mut found)?;
            for [a, b] in &found {
                let [a, b] = [others.ids[*a as usize], set.ids[*b as usize]];
                let (Some(a_now), Some(b_now)) = (self.now(a), self.now(b)) else { continue };
                if a_now.meets(&b_now) {
                    pairs.push((pair_of(a, b), a_now.corner_with(&b_now, axis)));
                }
            }
            others.ids.extend(set.ids);
            others.boxes.extend(set.boxes);
        }
        Ok(pairs)
    }
}

/// Boxes of one machine that may be pairs.
#[derive(Debug, Default)]
struct Set {
    ids: Vec<BoxId>,
    boxes: Vec<Aabb>,
}

impl Set {
    fn of(machine: MachineId, boxes: &HashMap<u32, Kept>) -> Self {
        let mut set = Self::default();
        for (index, kept) in boxes.iter().filter(|(_, kept)| kept.now.is_there()) {
            set.ids.push(BoxId { machine, index: *index, incarnation: kept.incarnation });
            set.boxes.push(kept.now.aabb);
        }
        set
    }
}
