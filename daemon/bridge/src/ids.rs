//! Names that hold on all machines: machines, their bridges, boxes, pairs.

/// A machine of a scene, chosen by who runs it: it stays the same when its bridge is started again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MachineId(pub u32);

/// A bridge: a machine, and which of its processes. A later process of a machine has a higher incarnation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Peer {
    /// The machine.
    pub machine: MachineId,
    /// The process.
    pub incarnation: u64,
}

/// A box: its index in the shared scene of the machine that writes it, and how many boxes the index has lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BoxId {
    /// Whose scene its writer is a member of.
    pub machine: MachineId,
    /// Its index there.
    pub index: u32,
    /// Boxes that the index had before.
    pub incarnation: u32,
}

/// Two boxes of different machines, the lower id first.
pub type PairId = [BoxId; 2];

/// The name of a pair.
pub fn pair_of(a: BoxId, b: BoxId) -> PairId {
    if a < b { [a, b] } else { [b, a] }
}
