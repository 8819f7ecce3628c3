//! What changed in a tick of the boxes that one bridge publishes to another: edits only, exact bits.

use pairmask_core::Aabb;
use pairmask_core::aabb::AABB_BYTES;
use pairmask_core::filters::{Filter, FilterData};

use super::Refused;
use super::bytes::{Reader, Writer};
use crate::state::BoxState;

const FILTER_DATA_BYTES: usize = size_of::<FilterData>();
/// Flags of a box in a message.
const ENABLED: u8 = 1;
const HAS_FILTER_DATA: u8 = 2;
const HAS_USER_DATA: u8 = 4;
const HAS_BEFORE: u8 = 8;
const HAS_FILTER: u8 = 16;
/// Flags of a filter in a message.
const STATIC: u8 = 1;
const EITHER: u8 = 2;

/// A box that the receiver does not have yet, or of which more changed than its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entered {
    /// Its index.
    pub index: u32,
    /// Boxes that the index had before.
    pub incarnation: u32,
    /// The box.
    pub state: BoxState,
    /// What it was before this tick, where it was there: by this the receiver knows whether a pair that it has just
    /// come to see began, or was another bridge's before.
    pub before: Option<BoxState>,
}

/// Edits of a tick, each list by rising index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    /// Boxes that only moved.
    pub moved: Vec<(u32, Aabb)>,
    /// Boxes that came into sight, and those of which more changed.
    pub entered: Vec<Entered>,
    /// Boxes that went out of sight, and what they are now: a pair of theirs that goes on is another bridge's from now on.
    pub left: Vec<(u32, BoxState)>,
    /// Boxes that were removed.
    pub removed: Vec<u32>,
}

fn write_box(to: &mut Writer, state: &BoxState, more: u8) {
    let mut flags = more;
    let mut flag = |bit, is_set: bool| flags |= if is_set { bit } else { 0 };
    flag(ENABLED, state.is_enabled);
    flag(HAS_FILTER_DATA, state.filter_data != FilterData::default());
    flag(HAS_USER_DATA, state.user_data != 0);
    flag(HAS_FILTER, state.filter != Filter::ALL);
    to.u8(flags);
    to.bytes(bytemuck::bytes_of(&state.aabb));
    if flags & HAS_FILTER_DATA != 0 {
        to.bytes(bytemuck::bytes_of(&state.filter_data));
    }
    if flags & HAS_USER_DATA != 0 {
        to.u64(state.user_data);
    }
    if flags & HAS_FILTER != 0 {
        let Filter { is_static, either, group, category, mask, .. } = state.filter;
        to.u8(if is_static { STATIC } else { 0 } | if either { EITHER } else { 0 });
        to.u32(group.cast_unsigned());
        to.u64(category);
        to.u64(mask);
    }
}

fn read_filter(from: &mut Reader<'_>) -> Result<Filter, Refused> {
    let flags = from.u8()?;
    if flags & !(STATIC | EITHER) != 0 {
        return Err(Refused::Field("flags of a filter"));
    }
    let group = from.u32()?.cast_signed();
    let filter = Filter::new(from.u64()?, from.u64()?).with_group(group);
    Ok(filter.with_static(flags & STATIC != 0).with_either(flags & EITHER != 0))
}

fn read_aabb(from: &mut Reader<'_>) -> Result<Aabb, Refused> {
    from.bytes(AABB_BYTES).map(bytemuck::pod_read_unaligned)
}

/// Reads a box, and whether another one follows that it was before.
fn read_box(from: &mut Reader<'_>, may_follow: bool) -> Result<(BoxState, bool), Refused> {
    let flags = from.u8()?;
    let known = ENABLED | HAS_FILTER_DATA | HAS_USER_DATA | HAS_FILTER;
    if flags & !(known | if may_follow { HAS_BEFORE } else { 0 }) != 0 {
        return Err(Refused::Field("flags of a box"));
    }
    let mut state = BoxState::from(read_aabb(from)?);
    state.is_enabled = flags & ENABLED != 0;
    if flags & HAS_FILTER_DATA != 0 {
        let read: FilterData = bytemuck::pod_read_unaligned(from.bytes(FILTER_DATA_BYTES)?);
        let known = FilterData::new(read.world, read.owner, read.filter);
        state.filter_data = known.with_static(read.is_static());
        if state.filter_data != read {
            return Err(Refused::Field("flags of filter data"));
        }
    }
    if flags & HAS_USER_DATA != 0 {
        state.user_data = from.u64()?;
    }
    if flags & HAS_FILTER != 0 {
        state.filter = read_filter(from)?;
    }
    Ok((state, flags & HAS_BEFORE != 0))
}

/// Indices that rise, each as its distance from the one before.
#[derive(Default)]
struct Rising {
    next: u64,
}

impl Rising {
    fn write(&mut self, to: &mut Writer, index: u32) {
        to.number(u64::from(index) - self.next);
        self.next = u64::from(index) + 1;
    }

    fn read(&mut self, from: &mut Reader<'_>) -> Result<u32, Refused> {
        let index = self.next.checked_add(from.number()?);
        let index = index.and_then(|index| u32::try_from(index).ok());
        let index = index.ok_or(Refused::Field("index"))?;
        self.next = u64::from(index) + 1;
        Ok(index)
    }
}

impl Edits {
    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        let Self { moved, entered, left, removed } = self;
        moved.is_empty() && entered.is_empty() && left.is_empty() && removed.is_empty()
    }

    /// Puts all lists in the order of indices.
    pub fn sort(&mut self) {
        self.moved.sort_unstable_by_key(|(index, _)| *index);
        self.entered.sort_unstable_by_key(|entered| entered.index);
        self.left.sort_unstable_by_key(|(index, _)| *index);
        self.removed.sort_unstable();
    }

    /// Sorted edits as bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut to = Writer::default();
        self.write(&mut to);
        to.0
    }

    fn write(&self, to: &mut Writer) {
        to.number(self.moved.len() as u64);
        let mut rising = Rising::default();
        for (index, aabb) in &self.moved {
            rising.write(to, *index);
            to.bytes(bytemuck::bytes_of(aabb));
        }
        to.number(self.entered.len() as u64);
        let mut rising = Rising::default();
        for Entered { index, incarnation, state, before } in &self.entered {
            rising.write(to, *index);
            to.number(u64::from(*incarnation));
            write_box(to, state, if before.is_some() { HAS_BEFORE } else { 0 });
            if let Some(before) = before {
                write_box(to, before, 0);
            }
        }
        to.number(self.left.len() as u64);
        let mut rising = Rising::default();
        for (index, state) in &self.left {
            rising.write(to, *index);
            write_box(to, state, 0);
        }
        to.number(self.removed.len() as u64);
        let mut rising = Rising::default();
        self.removed.iter().for_each(|index| rising.write(to, *index));
    }

    /// Reads edits, which are sorted then.
    pub(super) fn read(from: &mut Reader<'_>) -> Result<Self, Refused> {
        let mut edits = Self::default();
        let mut rising = Rising::default();
        for _ in 0..from.count(1 + AABB_BYTES)? {
            edits.moved.push((rising.read(from)?, read_aabb(from)?));
        }
        let mut rising = Rising::default();
        for _ in 0..from.count(3 + AABB_BYTES)? {
            let index = rising.read(from)?;
            let incarnation = u32::try_from(from.number()?);
            let incarnation = incarnation.map_err(|_| Refused::Field("incarnation"))?;
            let (state, follows) = read_box(from, true)?;
            let before = if follows { Some(read_box(from, false)?.0) } else { None };
            edits.entered.push(Entered { index, incarnation, state, before });
        }
        let mut rising = Rising::default();
        for _ in 0..from.count(2 + AABB_BYTES)? {
            edits.left.push((rising.read(from)?, read_box(from, false)?.0));
        }
        let mut rising = Rising::default();
        for _ in 0..from.count(1)? {
            edits.removed.push(rising.read(from)?);
        }
        Ok(edits)
    }
}
