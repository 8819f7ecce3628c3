//! Scripts: what happens to a scene, one event after the other, as data that can be cut and printed.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::Range;

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData};
pub use pairmask_core::scene::shared::{AtEnd, Scope};
pub use pairmask_core::scene::{EndReason, Ended, Report as Mode};

use crate::stress_scenes::Rng;

/// Indices of two boxes, the smaller one first where they are a pair.
pub type Pair = [u32; 2];

#[derive(Clone, Debug, PartialEq)]
pub enum Op {
    Remove(u32),
    Set(u32, Aabb),
    Enable(u32, bool),
    Static(u32, bool),
    FilterData(u32, FilterData),
    UserData(u32, u64),
    Filters(Vec<Filter>),
    Include(Pair, bool),
    Exclude(Pair, bool),
}

impl Op {
    pub const fn rank(&self) -> u32 {
        match self {
            Self::Remove(_) => 0,
            Self::Set(..) => 1,
            Self::Enable(..) | Self::Static(..) => 2,
            Self::FilterData(..)
            | Self::UserData(..)
            | Self::Filters(_)
            | Self::Include(..)
            | Self::Exclude(..) => 3,
        }
    }

    pub const fn is_rule(&self) -> bool {
        self.rank() == 3 && !matches!(self, Self::UserData(..))
    }

    pub fn indices(&self) -> &[u32] {
        match self {
            Self::Remove(index)
            | Self::Set(index, _)
            | Self::Enable(index, _)
            | Self::Static(index, _)
            | Self::UserData(index, _)
            | Self::FilterData(index, _) => std::slice::from_ref(index),
            Self::Include(pair, _) | Self::Exclude(pair, _) => pair,
            Self::Filters(_) => &[],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    Acknowledged,
    /// It is never waited for: the next answer makes up for it.
    Unread,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Turn {
    /// Who edits: 0 in a scene that is not shared.
    pub member: u32,
    pub ops: Vec<Op>,
    pub mode: Mode,
    pub fate: Fate,
}

/// What happens.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    Join(u32, Scope),
    Leave(u32),
    /// The listener of a scene that is not shared has lost its pairs.
    Invalidate,
    /// A snapshot is taken under a number, in place of one that was taken under it before.
    Snapshot(u32),
    /// The scene goes back to the snapshot of a number.
    Restore(u32),
    /// The snapshot of a number is forgotten.
    Forget(u32),
    /// Members commit, one after the other. Those that do not are late.
    Tick(Vec<Turn>),
}

/// All that happens to a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// Indices of a member are so many.
    pub limit: u32,
    /// Whether it is shared, and what becomes of the boxes of members that leave.
    pub shared: Option<AtEnd>,
    /// What happens.
    pub events: Vec<Event>,
}

/// Numbers of snapshots are below this.
const SNAPSHOTS: u32 = 4;

/// The member that no script lets leave: a shared scene ends with its last one.
pub(super) const HOST: u32 = 0;

impl Script {
    /// The indices of a member. There is an index of nobody between two members.
    pub fn own(&self, member: u32) -> Range<u32> {
        let first = if self.shared.is_some() { member * (self.limit + 1) } else { 0 };
        first..first + self.limit
    }

    pub fn turns(&self) -> impl Iterator<Item = &Turn> {
        let turns = self.events.iter().filter_map(|event| match event {
            Event::Tick(turns) => Some(turns),
            _ => None,
        });
        turns.flatten()
    }

    #[must_use]
    pub fn without_rules(mut self) -> Self {
        self.ticks_mut().flatten().for_each(|turn| turn.ops.retain(|op| !op.is_rule()));
        self
    }

    /// Takes snapshots now and then, and goes back to them.
    #[must_use]
    pub fn with_snapshots(mut self, seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let mut events = Vec::new();
        for event in self.events.drain(..) {
            for _ in 0..rng.below(3) {
                let number = rng.below(SNAPSHOTS);
                events.push(match rng.below(9) {
                    0 => Event::Forget(number),
                    1..5 => Event::Restore(number),
                    _ => Event::Snapshot(number),
                });
            }
            events.push(event);
        }
        self.events = events;
        self.repair();
        self
    }

    pub fn ticks_mut(&mut self) -> impl Iterator<Item = &mut Vec<Turn>> {
        self.events.iter_mut().filter_map(|event| match event {
            Event::Tick(turns) => Some(turns),
            _ => None,
        })
    }

    /// Takes out what no scene accepts: names of absent boxes, second sets, edits of those who have not joined.
    pub fn repair(&mut self) {
        // Of each member: the boxes that it has set.
        let mut joined: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        if self.shared.is_none() {
            joined.insert(HOST, BTreeSet::new());
        } else if !matches!(self.events.first(), Some(Event::Join(HOST, _))) {
            self.events.insert(0, Event::Join(HOST, Scope::All));
        }
        let mut snapshots: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        let owns: BTreeMap<u32, Range<u32>> = (0..8).map(|m| (m, self.own(m))).collect();
        self.events.retain_mut(|event| match event {
            Event::Join(member, _) if joined.contains_key(member) => false,
            Event::Join(member, _) => joined.insert(*member, BTreeSet::new()).is_none(),
            Event::Leave(member) => *member != HOST && joined.remove(member).is_some(),
            Event::Invalidate => true,
            Event::Snapshot(number) => {
                snapshots.insert(*number, joined[&HOST].clone());
                true
            }
            Event::Restore(number) => snapshots.get(number).is_some_and(|present| {
                joined.insert(HOST, present.clone());
                true
            }),
            Event::Forget(number) => snapshots.remove(number).is_some(),
            Event::Tick(turns) => {
                let first = joined.keys().next().copied();
                let mut committed = BTreeSet::new();
                turns.retain_mut(|turn| {
                    let Some(present) = joined.get_mut(&turn.member) else { return false };
                    repair_edit(&mut turn.ops, present, &owns[&turn.member], |op| {
                        !matches!(op, Op::Filters(_)) || first == Some(turn.member)
                    });
                    committed.insert(turn.member)
                });
                !turns.is_empty()
            }
        });
    }
}

pub(super) fn repair_edit(
    ops: &mut Vec<Op>,
    present: &mut BTreeSet<u32>,
    own: &Range<u32>,
    allows: impl Fn(&Op) -> bool,
) {
    ops.retain(|op| op.indices().iter().all(|index| own.contains(index)) && allows(op));
    ops.retain(|op| !matches!(op, Op::Remove(index) if !present.remove(index)));
    let mut set = BTreeSet::new();
    ops.retain(|op| !matches!(op, Op::Set(index, _) if !set.insert(*index)));
    present.extend(set);
    ops.retain(|op| match op {
        Op::Enable(index, _)
        | Op::Static(index, _)
        | Op::FilterData(index, _)
        | Op::UserData(index, _) => present.contains(index),
        Op::Include([a, b], _) | Op::Exclude([a, b], _) => a != b,
        Op::Remove(_) | Op::Set(..) | Op::Filters(_) => true,
    });
    // One table an edit: which boxes two of them name is not said.
    let mut has_table = false;
    ops.retain(|op| !matches!(op, Op::Filters(_)) || !std::mem::replace(&mut has_table, true));
}

pub const fn at([x, y, z, u, v, w]: [f32; 6]) -> Aabb {
    Aabb { min: [x, y, z], max: [u, v, w] }
}

pub fn one(ops: &[Op], mode: Mode, fate: Fate) -> Event {
    Event::Tick(vec![turn(HOST, ops, mode, fate)])
}

pub fn turn(member: u32, ops: &[Op], mode: Mode, fate: Fate) -> Turn {
    Turn { member, ops: ops.to_vec(), mode, fate }
}

/// As Rust that runs where all names of the enums are in scope.
impl fmt::Display for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shared = self.shared.map_or("None".into(), |end| format!("Some(AtEnd::{end:?})"));
        writeln!(f, "Script {{ limit: {}, shared: {shared}, events: vec![", self.limit)?;
        for event in &self.events {
            match event {
                Event::Join(member, scope) => {
                    writeln!(f, "    Event::Join({member}, Scope::{scope:?}),")?;
                }
                Event::Leave(member) => writeln!(f, "    Event::Leave({member}),")?,
                Event::Invalidate | Event::Snapshot(_) | Event::Restore(_) | Event::Forget(_) => {
                    writeln!(f, "    Event::{event:?},")?;
                }
                Event::Tick(turns) => {
                    writeln!(f, "    Event::Tick(vec![")?;
                    for Turn { member, ops, mode, fate } in turns {
                        write!(f, "        turn({member}, &[")?;
                        for (at, op) in ops.iter().enumerate() {
                            write!(f, "{}{op}", if at == 0 { "" } else { ", " })?;
                        }
                        writeln!(f, "], Mode::{mode:?}, Fate::{fate:?}),")?;
                    }
                    writeln!(f, "    ]),")?;
                }
            }
        }
        write!(f, "] }}")
    }
}

impl fmt::Display for Op {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Set(index, b) => {
                let corners = [b.min, b.max].concat();
                let corners: Vec<String> = corners.iter().map(|x| written(*x)).collect();
                write!(f, "Set({index}, at([{}]))", corners.join(", "))
            }
            Self::FilterData(index, filter_data) => {
                let (world, owner, filter) =
                    (filter_data.world, filter_data.owner, filter_data.filter);
                write!(
                    f,
                    "Filter data({index}, Filter data::new({world:?}, {owner:?}, {filter:?})"
                )?;
                write!(f, "{})", if filter_data.is_static() { ".with_static(true)" } else { "" })
            }
            Self::Filters(filters) => {
                write!(f, "Filters(vec![")?;
                for x in filters {
                    write!(f, "Filter::new({}, {})", x.category, x.mask)?;
                    write!(f, ".with_group({}).with_static({})", x.group, x.is_static)?;
                    write!(f, ".with_either({}), ", x.either)?;
                }
                write!(f, "])")
            }
            _ => write!(f, "{self:?}"),
        }
    }
}

fn written(x: f32) -> String {
    if x.is_nan() {
        "f32::NAN".into()
    } else if x.is_infinite() {
        if x > 0.0 { "f32::INFINITY".into() } else { "f32::NEG_INFINITY".into() }
    } else {
        format!("{x:?}")
    }
}
