//! Random scripts of a seed.
//!
//! Each seed draws which verbs there are at all, how many indices, and how boxes lie: faults in corners are found
//! by scripts that stay in few of them (Groce et al., "Swarm testing", 2012). Faults of first edits are found by
//! many short scripts, not by a long one.

use std::collections::BTreeSet;

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData, FilterId, Owner, World};

use super::model::Model;
use super::script::{AtEnd, Event, Fate, Mode, Op, Scope, Script, Turn, repair_edit};
use crate::stress_scenes::Rng;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Small,
    /// Some hundred boxes in one place, distinguished by filters: changes by the thousand.
    Crowd,
    /// 200 to 6,000 boxes, of which few or many change: beyond the borders between the ways of searching.
    Large,
    /// Up to 100,000 boxes, in few edits.
    Huge,
    Shared,
}

const VERBS: usize = 9;
pub(super) const MEMBERS: u32 = 3;

struct Maker {
    random: Rng,
    kind: Kind,
    limit: u32,
    /// Edge of the world, in quarters.
    world: u32,
    verbs: [bool; VERBS],
    /// One box in so many overlaps nothing, or nearly all.
    odd: u32,
    /// Indices that the edit under way names often: faults are of several changes of one box.
    focus: [u32; 2],
    /// A member is late once in so many ticks; 0: never.
    late: u32,
    /// One answer in so many is not acknowledged.
    dropped: u32,
    /// Groups of ops of an edit: fewer than this, and often none where it is small.
    groups: u32,
    /// Of a script.
    events: u32,
    /// Boxes that come again and again: what is set is often what there was.
    usual: Vec<Aabb>,
}

pub fn script_of(kind: Kind, seed: u64) -> Script {
    let mut maker = Maker::new(kind, seed, None);
    let shared = (kind == Kind::Shared).then(|| maker.one_of(&[AtEnd::Remove, AtEnd::Keep]));
    let mut script = Script { limit: maker.limit, shared, events: Vec::new() };
    for number in 0..maker.events {
        maker.event(&mut script, number);
    }
    script.repair();
    script
}

/// Edits of one scene without an end, each right after those before it.
pub struct Edits {
    maker: Maker,
    present: BTreeSet<u32>,
    model: Model,
    number: u32,
    has_rules: bool,
}

/// Edits until others verbs are drawn.
const STRETCH: u32 = 30;

impl Edits {
    pub fn new(seed: u64, limit: u32) -> Self {
        let kind = if limit > 70 { Kind::Large } else { Kind::Small };
        let maker = Maker::new(kind, seed, Some(limit));
        let (present, model) = (BTreeSet::new(), Model::default());
        Self { maker, present, model, number: 0, has_rules: true }
    }

    #[must_use]
    pub fn without_rules(mut self) -> Self {
        self.has_rules = false;
        self
    }

    pub const fn model(&self) -> &Model {
        &self.model
    }

    /// Where boxes lie: from 0 to this, and a little beyond.
    pub fn extent(&self) -> f32 {
        self.maker.world as f32 / 4.0
    }

    /// The next edit. Most boxes are set at once now and then, and sometimes all are removed before.
    pub fn next_edit(&mut self) -> Vec<Op> {
        let mut ops = Vec::new();
        match self.number % STRETCH {
            0 => {
                self.maker.draw_verbs();
                self.maker.fill(&mut ops);
            }
            29 if self.maker.one_in(3) => ops.extend(self.present.iter().copied().map(Op::Remove)),
            _ => self.maker.edit(&mut ops),
        }
        self.number += 1;
        ops.retain(|op| self.has_rules || !op.is_rule());
        repair_edit(&mut ops, &mut self.present, &(0..self.maker.limit), |_| true);
        self.model.apply(0, &ops);
        ops
    }
}

const REMOVE: usize = 0;
const SET: usize = 1;
const ENABLE: usize = 2;
const STATIC: usize = 3;
const FILTER_DATUM: usize = 4;
const FILTERS: usize = 5;
const LISTS: usize = 6;
const RENEW: usize = 7;
const USER_DATA: usize = 8;

impl Maker {
    fn new(kind: Kind, seed: u64, limit: Option<u32>) -> Self {
        let mut random = Rng::new(seed);
        let mut below = |n: u32| random.below(n.max(1));
        let drawn = match (kind, below(8)) {
            (Kind::Small, 0..4) => 2 + below(4),
            (Kind::Small, 4..7) => 4 + below(13),
            (Kind::Small, _) => below(71),
            (Kind::Crowd, _) => 60 + below(120),
            (Kind::Large, 0) => 4_000 + below(2_001),
            (Kind::Large, 1..4) => 800 + below(3_200),
            (Kind::Large, _) => 200 + below(600),
            (Kind::Huge, _) => 20_000 + below(80_001),
            (Kind::Shared, 0..4) => 1,
            (Kind::Shared, 4..7) => 1 + below(4),
            // More than a word of indices.
            (Kind::Shared, _) => 40 + below(60),
        };
        let limit = limit.unwrap_or(drawn);
        let world = match kind {
            // About four overlaps a box.
            Kind::Large | Kind::Huge => {
                (4.0 * (limit as f32).cbrt() * (0.5 + below(4) as f32 / 2.0)) as u32 + 1
            }
            Kind::Crowd => 1 + below(4),
            Kind::Small => 1 + below(12) + limit,
            Kind::Shared => 1 + below(8) + limit,
        };
        let (late, groups) = ([0, 12, 3, 2][below(4) as usize], [1, 3, 6][below(3) as usize]);
        let dropped = 2 + below(4);
        let odd = if limit > 100 { limit / 2 } else { 12 };
        let events = match kind {
            Kind::Small | Kind::Shared => 4 + below(24),
            Kind::Crowd | Kind::Large | Kind::Huge => 4 + below(8),
        };
        let (verbs, focus, usual) = ([true; VERBS], [0; 2], Vec::new());
        let mut maker = Self {
            random,
            kind,
            limit,
            world,
            verbs,
            odd,
            focus,
            late,
            dropped,
            groups,
            events,
            usual,
        };
        maker.draw_verbs();
        maker.usual = (0..3).map(|_| maker.a_box()).collect();
        maker
    }

    fn draw_verbs(&mut self) {
        self.verbs = [(); VERBS].map(|()| self.below(5) < 3);
        // Without boxes nothing happens.
        self.verbs[SET] = true;
    }

    fn below(&mut self, end: u32) -> u32 {
        self.random.below(end.max(1))
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == 0
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u32) as usize]
    }

    fn event(&mut self, script: &mut Script, number: u32) {
        let members: Vec<u32> = if self.kind == Kind::Shared {
            if number == 0 || self.one_in(5) {
                let (member, scope) = (self.below(MEMBERS), self.one_of(&[Scope::Own, Scope::All]));
                script.events.push(Event::Join(member, scope));
            } else if self.one_in(8) {
                let member = self.below(MEMBERS);
                script.events.push(Event::Leave(member));
            }
            (0..MEMBERS).filter(|_| self.late == 0 || !self.one_in(self.late)).collect()
        } else {
            if self.one_in(20) {
                script.events.push(Event::Invalidate);
            }
            vec![0]
        };
        let turns = members.into_iter().map(|member| {
            let own = script.own(member);
            let mut ops = Vec::new();
            if number == 0 && self.limit > 0 {
                self.fill(&mut ops);
            }
            self.edit(&mut ops);
            for op in &mut ops {
                move_by(op, own.start);
            }
            self.turn(member, ops)
        });
        let turns = turns.collect();
        script.events.push(Event::Tick(turns));
    }

    fn turn(&mut self, member: u32, ops: Vec<Op>) -> Turn {
        let mode = match self.below(8) {
            0 => Mode::All,
            1 => Mode::Moved,
            2 => Mode::Nothing,
            _ => Mode::Changes,
        };
        let fate = if self.one_in(self.dropped) { Fate::Unread } else { Fate::Acknowledged };
        Turn { member, ops, mode, fate }
    }

    fn fill(&mut self, ops: &mut Vec<Op>) {
        let first = if self.one_in(2) { self.below(self.limit) / 8 } else { 0 };
        for index in first..self.limit {
            let b = self.a_box();
            ops.push(Op::Set(index, b));
        }
    }

    fn an_index(&mut self) -> u32 {
        if self.one_in(2) { self.one_of(&self.focus.clone()) } else { self.below(self.limit) }
    }

    fn count(&mut self) -> u32 {
        if self.limit <= 16 {
            return if self.one_in(6) { self.limit } else { 1 + self.below(2) };
        }
        match self.below(8) {
            0 => self.limit,
            1 => self.limit / 2,
            2 => self.limit / 5,
            // About the border between few and many.
            3 => self.limit / 7 + self.below(self.limit / 14),
            4 => 50 + self.below(30),
            _ => 1 + self.below(4),
        }
    }

    fn edit(&mut self, ops: &mut Vec<Op>) {
        self.focus = [(); 2].map(|()| self.below(self.limit));
        let groups = self.below(self.groups + 1).min(self.below(self.groups + 1));
        for _ in 0..groups {
            self.group(ops);
        }
    }

    fn group(&mut self, ops: &mut Vec<Op>) {
        let verb = self.below(VERBS as u32) as usize;
        if !self.verbs[verb] || self.limit == 0 {
            return;
        }
        if verb == FILTERS {
            ops.push(Op::Filters((0..self.below(4)).map(|_| self.a_filter()).collect()));
            return;
        }
        let count = self.count();
        let mut indices: Vec<u32> = if self.one_in(3) {
            let first = self.below(self.limit + 1 - count.min(self.limit));
            (first..(first + count).min(self.limit)).collect()
        } else {
            (0..count).map(|_| self.an_index()).collect()
        };
        if self.one_in(2) {
            indices.sort_unstable();
            indices.dedup();
        }
        // Alike for all of them, or drawn for each.
        let alike = [(); 2].map(|()| self.one_in(2));
        let (filter_data, b) = (self.some_filter_data(), self.a_box());
        for index in indices {
            let on = if alike[0] { alike[1] } else { self.one_in(2) };
            match verb {
                REMOVE => ops.push(Op::Remove(index)),
                SET => {
                    let b = if alike[0] && count < 70 { b } else { self.a_box() };
                    ops.push(Op::Set(index, b));
                }
                ENABLE => ops.push(Op::Enable(index, on)),
                STATIC => ops.push(Op::Static(index, on)),
                FILTER_DATUM => {
                    let filter_data = if alike[0] { filter_data } else { self.some_filter_data() };
                    ops.push(Op::FilterData(index, filter_data));
                }
                LISTS => {
                    let pair = [index, self.an_index()];
                    let list = if alike[1] { Op::Include } else { Op::Exclude };
                    let on = !self.one_in(4);
                    ops.push(list(pair, on));
                }
                USER_DATA => {
                    let user_data = [0, u64::from(self.below(3)), u64::MAX - 7];
                    ops.push(Op::UserData(index, self.one_of(&user_data)));
                }
                RENEW => {
                    ops.push(Op::Remove(index));
                    let b = self.a_box();
                    ops.push(Op::Set(index, b));
                }
                _ => {}
            }
        }
    }

    fn a_box(&mut self) -> Aabb {
        if !self.usual.is_empty() && self.limit <= 16 && self.one_in(3) {
            return self.one_of(&self.usual.clone());
        }
        let flat = self.limit <= 16 && self.one_in(2);
        let min: [f32; 3] = std::array::from_fn(|axis| {
            let end = if flat && axis > 0 { 1 } else { self.world };
            self.below(end) as f32 / 4.0
        });
        let mut b = Aabb::new(min, min.map(|low| low + self.below(8) as f32 / 4.0));
        if !self.one_in(self.odd) {
            return b;
        }
        let axis = self.below(3) as usize;
        match self.below(7) {
            0 => b = Aabb::EMPTY,
            1 => b.min[axis] = f32::NAN,
            2 => b.max[axis] = f32::INFINITY,
            3 => b = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]),
            4 => b = Aabb::new([-0.0; 3], [0.0; 3]),
            5 => b = Aabb::new([1e-45; 3], [2e-40; 3]),
            _ => b = Aabb::new(b.max, b.min),
        }
        b
    }

    fn some_filter_data(&mut self) -> FilterData {
        let world = if self.one_in(3) { World(self.below(3) as i32 - 1) } else { World(0) };
        let owner = if self.one_in(3) { Owner(self.below(3)) } else { Owner::NONE };
        // What it says of static boxes counts in frames alone.
        FilterData::new(world, owner, FilterId(self.below(4) as u16)).with_static(self.one_in(4))
    }

    fn a_filter(&mut self) -> Filter {
        let filter = Filter::new(u64::from(self.below(4)), u64::from(self.below(4)));
        let group = if self.one_in(3) { self.below(5) as i32 - 2 } else { 0 };
        filter.with_group(group).with_static(self.one_in(5)).with_either(self.one_in(2))
    }
}

fn move_by(op: &mut Op, by: u32) {
    match op {
        Op::Remove(index)
        | Op::Set(index, _)
        | Op::Enable(index, _)
        | Op::Static(index, _)
        | Op::UserData(index, _)
        | Op::FilterData(index, _) => *index += by,
        Op::Include(pair, _) | Op::Exclude(pair, _) => pair.iter_mut().for_each(|i| *i += by),
        Op::Filters(_) => {}
    }
}
