//! A view: the bridges that take part, and whose slabs are where. Each has its own streams of boxes, from a snapshot on.

use std::ops::Range;

use crate::ids::{MachineId, Peer};
use crate::space::Space;

/// Most members of a view: bounds what bytes from outside can ask for.
pub const MOST_MEMBERS: usize = 4_096;

/// Which of two views is the later one: by its number, and then by who has proposed it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Version {
    /// Higher than that of every view that its steward knew of.
    pub counter: u64,
    /// Who has proposed it.
    pub steward: MachineId,
}

/// Who takes part, and who owns which slab.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Its version.
    pub version: Version,
    /// Its members, by machine.
    pub members: Vec<Peer>,
    /// The slabs. Their owners are places in the members.
    pub space: Space,
}

impl View {
    /// The place of a bridge among the members.
    pub fn place(&self, peer: Peer) -> Option<usize> {
        self.members.binary_search(&peer).ok()
    }

    /// The bridge that owns the place of a coordinate.
    pub fn owner(&self, x: f32) -> Peer {
        self.members[self.space.owner(x)]
    }

    /// The slab of a member.
    pub fn owned_by(&self, peer: Peer) -> Range<f32> {
        let place = self.place(peer);
        let Space { cuts, owners, .. } = &self.space;
        let slab = owners.iter().position(|owner| Some(usize::from(*owner)) == place);
        let Some(slab) = slab else { return 0.0..0.0 };
        let cut = |at: Option<usize>| at.and_then(|at| cuts.get(at)).copied();
        let start = cut(slab.checked_sub(1)).unwrap_or(f32::NEG_INFINITY);
        start..cut(Some(slab)).unwrap_or(f32::INFINITY)
    }
}
