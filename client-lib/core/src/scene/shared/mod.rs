//! One scene that several members write: who may write which indices, when a tick ends, and what each
//! member has not received yet. State machines without effects: a daemon gives them instants and events.
//!
//! ```text
//! leases       ranges of indices, each of one member; what an edit of a member may name
//! ticks        a tick ends when all writers have committed, or at its deadline
//! remains      what is left of ranges whose lease has ended
//! unreported   changes of several ticks as one, those of some indices alone
//! moved        which boxes moved at which tick
//! ```

mod leases;
mod moved;
mod remains;
mod ticks;
mod unreported;

pub use self::leases::{LeaseError, Leases, NotLeased, Ranges};
pub use self::moved::MovedBoxes;
pub use self::remains::{RemainingBoxes, Remains, Reset, remove_range};
pub use self::ticks::{Closed, Ticks};
pub use self::unreported::{Incarnations, NamedPair, TickChanges, Unreported};

/// A member of a shared scene, for its whole life: numbers are given in the order of joining.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MemberId(pub u64);

/// Which pairs are reported to a member of a shared scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Scope {
    /// Those that touch a box of its own leases.
    #[default]
    Own,
    /// All.
    All,
}

/// What becomes of the boxes of a writer that ends without giving its leases back, and of listed pairs that name
/// their indices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AtEnd {
    /// They are removed.
    #[default]
    Remove,
    /// They stay where they are, for who leases their indices next. A box that this one sets is the same box, with the
    /// flags, filter data and listed pairs that the new writer gives it.
    Keep,
}
