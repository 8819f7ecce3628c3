//! Messages between bridges, byte by byte.
//!
//! ```text
//! head     magic "PMBR" u32, version u16, kind u16, scene u64, machine u32, incarnation u64
//! beat     to all: who is there, its tick, what it knows of views, how its boxes are spread
//! propose  to a member: a view
//! batch    to a member: what changed since a tick, of the boxes near its slab
//! ```
//!
//! All is little-endian. A message that is truncated, malformed, of another version, of another scene or of a bridge with
//! other terms is refused by name, and has no effect.

mod bytes;
mod edits;

use self::bytes::{Reader, Writer};
pub use self::edits::{Edits, Entered};

use crate::ids::{MachineId, Peer};
use crate::space::{QUANTILES, Space, Spread};
use crate::view::{MOST_MEMBERS, Version, View};

/// "PMBR".
const MAGIC: u32 = u32::from_le_bytes(*b"PMBR");
/// The version of these messages. Bridges of another one are refused: a scene has no use for half of its machines.
pub const PROTOCOL_VERSION: u16 = 2;
/// Bytes of a head.
pub const HEAD_BYTES: usize = 28;
/// Longest message, bytes: a snapshot of two million boxes. More are not read.
pub const MOST_MESSAGE_BYTES: usize = 64 << 20;

/// Why a message has no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refused {
    /// It is no message of a bridge.
    #[error("no message of a bridge: it begins with {0:#010x}")]
    Magic(u32),
    /// It is of another version.
    #[error("version {0} of the bridges' messages, this bridge speaks {PROTOCOL_VERSION}")]
    Version(u16),
    /// It is of no known kind.
    #[error("message of unknown kind {0}")]
    Kind(u16),
    /// It is about another scene.
    #[error("a message about another scene")]
    Scene,
    /// It ends too soon.
    #[error("a message that ends too soon")]
    Truncated,
    /// It is longer than a message may be.
    #[error("a message of {0} bytes, {MOST_MESSAGE_BYTES} are the most")]
    TooLong(usize),
    /// A field is wrong.
    #[error("a message whose field '{0}' is wrong")]
    Field(&'static str),
    /// Another bridge has started with the same machine number.
    #[error("machine {0} is a number that another bridge has as well")]
    SameMachine(u32),
    /// A bridge has other terms.
    #[error("machine {machine} has another {term} than this one")]
    Terms {
        /// Its number.
        machine: u32,
        /// What differs.
        term: &'static str,
    },
}

/// What all bridges of a scene have to agree on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// Across which axis space is cut.
    pub axis: u8,
    /// A bridge counts as lost after so long without a message, ms.
    pub lease_ms: u32,
}

/// What a bridge says to all others, some times a lease.
#[derive(Clone, Debug, PartialEq)]
pub struct Beat {
    /// Its terms.
    pub terms: Terms,
    /// Its tick.
    pub tick: u64,
    /// Whether it has listened long enough to know who else is there.
    pub is_settled: bool,
    /// The highest number of a view that it knows of.
    pub counter: u64,
    /// Members from which it has no acknowledgement for a lease.
    pub suspects: Vec<MachineId>,
    /// How its own boxes are spread.
    pub spread: Spread,
}

/// What changed of the boxes near a member's slab.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// To whom.
    pub to: Peer,
    /// In which view.
    pub version: Version,
    /// The sender's view before that one.
    pub prior: Version,
    /// The first tick of the view, once its steward has it from all members; else 0.
    pub start: u64,
    /// The sender evaluates no tick after this one in an earlier view until it knows the start.
    pub hold: u64,
    /// All up to this tick has been received of the receiver's batches in this view.
    pub acknowledged: u64,
    /// The highest tick of a batch that came.
    pub seen: u64,
    /// The tick before: of the batch that this one follows, 0 for the first.
    pub since: u64,
    /// The tick whose boxes these are.
    pub tick: u64,
    /// The edits.
    pub edits: Edits,
}

/// A view that a member may accept.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// The view.
    pub view: View,
    /// The view that it follows at its steward, and the first tick of that one: a member that has accepted that and does not know
    /// where it starts learns it here.
    pub base: Version,
    /// The first tick.
    pub base_start: u64,
}

/// A message.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// To all.
    Beat(Beat),
    /// To a member.
    Propose(Proposal),
    /// To a member.
    Batch(Batch),
}

/// From whom a message is, and about which scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// A hash of the scene's name.
    pub scene: u64,
    /// Who has sent it.
    pub from: Peer,
}

fn write_peer(to: &mut Writer, peer: Peer) {
    to.u32(peer.machine.0);
    to.u64(peer.incarnation);
}

fn read_peer(from: &mut Reader<'_>) -> Result<Peer, Refused> {
    Ok(Peer { machine: MachineId(from.u32()?), incarnation: from.u64()? })
}

fn write_version(to: &mut Writer, version: Version) {
    to.number(version.counter);
    to.u32(version.steward.0);
}

fn read_version(from: &mut Reader<'_>) -> Result<Version, Refused> {
    Ok(Version { counter: from.number()?, steward: MachineId(from.u32()?) })
}

fn read_axis(from: &mut Reader<'_>) -> Result<u8, Refused> {
    let axis = from.u8()?;
    if axis < 3 { Ok(axis) } else { Err(Refused::Field("axis")) }
}

impl Head {
    fn write(&self, kind: u16) -> Writer {
        let mut to = Writer::default();
        to.u32(MAGIC);
        to.u32(u32::from(PROTOCOL_VERSION) | u32::from(kind) << 16);
        to.u64(self.scene);
        write_peer(&mut to, self.from);
        to
    }

    /// Writes a message.
    pub fn message(&self, message: &Message) -> Vec<u8> {
        match message {
            Message::Beat(beat) => {
                let mut to = self.write(0);
                beat.write(&mut to);
                to.0
            }
            Message::Propose(proposal) => {
                let mut to = self.write(1);
                write_version(&mut to, proposal.base);
                to.number(proposal.base_start);
                proposal.view.write(&mut to);
                to.0
            }
            Message::Batch(batch) => self.batch(batch, &batch.edits.to_bytes()),
        }
    }

    /// Writes a batch whose edits are written already, regardless of those that it has.
    pub fn batch(&self, batch: &Batch, edits: &[u8]) -> Vec<u8> {
        let mut to = self.write(2);
        write_peer(&mut to, batch.to);
        write_version(&mut to, batch.version);
        write_version(&mut to, batch.prior);
        to.number(batch.tick);
        for value in [batch.since, batch.acknowledged, batch.seen, batch.start, batch.hold] {
            to.difference(batch.tick, value);
        }
        to.bytes(edits);
        to.0
    }

    /// Reads a message.
    ///
    /// # Errors
    /// [`Refused`].
    pub fn read(bytes: &[u8]) -> Result<(Self, Message), Refused> {
        if bytes.len() > MOST_MESSAGE_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let mut from = Reader(bytes);
        let magic = from.u32()?;
        if magic != MAGIC {
            return Err(Refused::Magic(magic));
        }
        let word = from.u32()?;
        let (version, kind) = (word as u16, (word >> 16) as u16);
        if version != PROTOCOL_VERSION {
            return Err(Refused::Version(version));
        }
        let head = Self { scene: from.u64()?, from: read_peer(&mut from)? };
        let message = match kind {
            0 => Message::Beat(Beat::read(&mut from)?),
            1 => {
                let (base, base_start) = (read_version(&mut from)?, from.number()?);
                let view = View::read(&mut from)?;
                Message::Propose(Proposal { view, base, base_start })
            }
            2 => Message::Batch(Batch::read(&mut from)?),
            other => return Err(Refused::Kind(other)),
        };
        from.end()?;
        Ok((head, message))
    }
}

impl Beat {
    fn write(&self, to: &mut Writer) {
        to.u8(self.terms.axis);
        to.u32(self.terms.lease_ms);
        to.u64(self.tick);
        to.u8(self.is_settled.into());
        to.number(self.counter);
        to.number(self.suspects.len() as u64);
        self.suspects.iter().for_each(|machine| to.u32(machine.0));
        to.u32(self.spread.count);
        to.bytes(bytemuck::bytes_of(&self.spread.quantiles));
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Refused> {
        let axis = read_axis(from)?;
        let terms = Terms { axis, lease_ms: from.u32()? };
        let tick = from.u64()?;
        let is_settled = from.u8()? != 0;
        let counter = from.number()?;
        let count = from.count(4)?;
        if count > MOST_MEMBERS {
            return Err(Refused::Field("suspects"));
        }
        let suspects = (0..count).map(|_| from.u32().map(MachineId)).collect::<Result<_, _>>()?;
        let count = from.u32()?;
        let mut quantiles = [0.0; QUANTILES];
        for quantile in &mut quantiles {
            *quantile = from.f32()?;
        }
        if !quantiles.iter().all(|x| x.is_finite()) || !quantiles.is_sorted() {
            return Err(Refused::Field("quantiles"));
        }
        let spread = Spread { count, quantiles };
        Ok(Self { terms, tick, is_settled, counter, suspects, spread })
    }
}

impl View {
    fn write(&self, to: &mut Writer) {
        write_version(to, self.version);
        to.u8(self.space.axis);
        to.number(self.members.len() as u64);
        for (member, owner) in self.members.iter().zip(&self.space.owners) {
            write_peer(to, *member);
            to.u32(u32::from(*owner));
        }
        self.space.cuts.iter().for_each(|cut| to.bytes(&cut.to_le_bytes()));
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Refused> {
        let version = read_version(from)?;
        let axis = read_axis(from)?;
        let count = from.count(16)?;
        if count == 0 || count > MOST_MEMBERS {
            return Err(Refused::Field("members"));
        }
        let (mut members, mut owners) = (Vec::new(), Vec::new());
        for _ in 0..count {
            members.push(read_peer(from)?);
            owners.push(from.u32()?);
        }
        let cuts: Vec<f32> = (1..count).map(|_| from.f32()).collect::<Result<_, _>>()?;
        if !members.is_sorted_by(|a, b| a.machine < b.machine) {
            return Err(Refused::Field("order of members"));
        }
        if !cuts.iter().all(|cut| cut.is_finite()) || !cuts.is_sorted() {
            return Err(Refused::Field("cuts"));
        }
        let mut sorted = owners.clone();
        sorted.sort_unstable();
        if !sorted.into_iter().eq(0..count as u32) {
            return Err(Refused::Field("owners"));
        }
        let owners = owners.into_iter().map(|owner| owner as u16).collect();
        Ok(Self { version, members, space: Space { axis, cuts, owners } })
    }
}

impl Batch {
    fn read(from: &mut Reader<'_>) -> Result<Self, Refused> {
        let to = read_peer(from)?;
        let (version, prior) = (read_version(from)?, read_version(from)?);
        let tick = from.number()?;
        let mut near = [0; 5];
        for value in &mut near {
            *value = from.difference(tick)?;
        }
        let [since, acknowledged, seen, start, hold] = near;
        // A batch that only acknowledges follows itself.
        if since > tick {
            return Err(Refused::Field("tick"));
        }
        let edits = Edits::read(from)?;
        Ok(Self { to, version, prior, start, hold, acknowledged, seen, since, tick, edits })
    }
}

#[cfg(test)]
mod tests;
