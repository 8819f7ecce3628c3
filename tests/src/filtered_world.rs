//! Random edits of scenes with rules, and a model that knows every box, every rule and every pair.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterId, FilterTable, Owner, Tag, World};
use pairmask_core::scene::{Edit, Ended};
use pairmask_core::scene::{EndReason, Scene, Sets, Step, Tags, Told, Want};

type Pair = [u32; 2];

/// Numbers of chance.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        self.0 >> 33
    }

    fn below(&mut self, end: u32) -> u32 {
        (self.next() % u64::from(end.max(1))) as u32
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == 0
    }
}

#[derive(Clone, Copy, Debug)]
struct Body {
    b: Aabb,
    is_on: bool,
    is_static: bool,
    tag: Tag,
    /// Which box it is of all that ever were.
    number: u64,
}

/// Boxes and rules as a table of plain things.
#[derive(Clone, Debug, Default)]
struct Model {
    bodies: BTreeMap<u32, Body>,
    filters: Vec<Filter>,
    included: BTreeSet<Pair>,
    excluded: BTreeSet<Pair>,
}

impl Model {
    /// The seven rules, in their order.
    fn may_meet(&self, a: u32, b: u32) -> bool {
        let [x, y] = [a, b].map(|index| &self.bodies[&index]);
        let [f, g] = [x, y].map(|body| {
            let at = usize::from(body.tag.filter.0);
            self.filters.get(at).copied().unwrap_or(Filter::ALL)
        });
        let pair = [a.min(b), a.max(b)];
        let (w, v) = (x.tag.world.0, y.tag.world.0);
        if w != v && w != -1 && v != -1 {
            return false;
        }
        if self.included.contains(&pair) {
            return true;
        }
        if x.tag.owner == y.tag.owner && x.tag.owner.0 != 0 {
            return false;
        }
        if (x.is_static || f.is_static) && (y.is_static || g.is_static) {
            return false;
        }
        if self.excluded.contains(&pair) {
            return false;
        }
        if f.group == g.group && f.group != 0 {
            return f.group > 0;
        }
        let (one, other) = (f.category & g.mask != 0, g.category & f.mask != 0);
        if f.either && g.either { one || other } else { one && other }
    }

    /// All pairs of now, and which boxes they are of.
    fn pairs(&self) -> BTreeMap<Pair, [u64; 2]> {
        let mut pairs = BTreeMap::new();
        let solid = self.bodies.iter().filter(|(_, body)| body.is_on);
        for (a, x) in solid.clone() {
            for (b, y) in solid.clone().filter(|(b, _)| *b > a) {
                let over = |i: usize| x.b.min[i] <= y.b.max[i] && y.b.min[i] <= x.b.max[i];
                if over(0) && over(1) && over(2) && self.may_meet(*a, *b) {
                    pairs.insert([*a, *b], [x.number, y.number]);
                }
            }
        }
        pairs
    }

    /// Why a pair of then is none.
    fn reason(&self, [a, b]: Pair, numbers: [u64; 2]) -> EndReason {
        let [x, y] = [a, b].map(|index| self.bodies.get(&index));
        let (Some(x), Some(y)) = (x, y) else { return EndReason::Removed };
        if [x.number, y.number] != numbers {
            EndReason::Removed
        } else if !x.is_on || !y.is_on || !self.may_meet(a, b) {
            EndReason::Filtered
        } else {
            EndReason::Separated
        }
    }
}

/// An edit, before it is written as steps.
#[derive(Default)]
struct Draft {
    removed: Vec<u32>,
    set: Vec<(u32, Aabb)>,
    switched: Vec<(u32, bool)>,
    statics: Vec<(u32, bool)>,
    tagged: Vec<(u32, Tag)>,
    table: Option<FilterTable>,
    included: Vec<(Pair, bool)>,
    excluded: Vec<(Pair, bool)>,
}

/// Boxes and rules, and the edits that change them.
struct FilteredWorld {
    model: Model,
    random: Random,
    numbers: u64,
    limit: u32,
    extent: u32,
}

impl FilteredWorld {
    fn a_box(&mut self) -> Aabb {
        let (extent, r) = (self.extent, &mut self.random);
        let min: [f32; 3] = std::array::from_fn(|_| r.below(extent) as f32 / 4.0);
        let max = min.map(|low| low + r.below(7) as f32 / 4.0);
        Aabb::new(min, max)
    }

    fn a_tag(&mut self) -> Tag {
        let r = &mut self.random;
        let world = if r.one_in(3) { World(r.below(3) as i32 - 1) } else { World(0) };
        let owner = if r.one_in(3) { Owner(r.below(4)) } else { Owner::NONE };
        Tag::new(world, owner, FilterId(r.below(6) as u16))
    }

    fn a_table(&mut self) -> FilterTable {
        let r = &mut self.random;
        let filters: Vec<Filter> = (0..r.below(6))
            .map(|_| {
                let filter = Filter::new(u64::from(r.below(4)), u64::from(r.below(4)));
                let group = if r.one_in(3) { r.below(5) as i32 - 2 } else { 0 };
                filter.with_group(group).with_static(r.one_in(5)).with_either(r.one_in(2))
            })
            .collect();
        FilterTable::new(&filters).expect("few filters")
    }

    /// Draws an edit, and makes it in the model.
    fn draw(&mut self, changes: u32) -> Draft {
        let mut draft = Draft::default();
        for _ in 0..self.random.below(changes + 1) {
            let index = self.random.below(self.limit);
            let present = self.model.bodies.contains_key(&index);
            let is_set = draft.set.iter().any(|(i, _)| *i == index);
            let is_removed = draft.removed.contains(&index);
            let is_flagged = draft.switched.iter().chain(&draft.statics).any(|(i, _)| *i == index)
                || draft.tagged.iter().any(|(i, _)| *i == index);
            let on = self.random.one_in(2);
            match self.random.below(9) {
                0 if present && !is_set && !is_removed && !is_flagged => draft.removed.push(index),
                1..=3 if !is_set => {
                    let b = self.a_box();
                    draft.set.push((index, b));
                }
                4 if present && !is_removed => draft.switched.push((index, on)),
                5 if is_set || present && !is_removed => draft.statics.push((index, on)),
                6 | 7 if is_set || present && !is_removed => {
                    let tag = self.a_tag();
                    draft.tagged.push((index, tag));
                }
                8 => {
                    let other = self.random.below(self.limit);
                    let list = if self.random.one_in(2) {
                        &mut draft.included
                    } else {
                        &mut draft.excluded
                    };
                    if other != index {
                        list.push(([index, other], on));
                    }
                }
                _ => {}
            }
        }
        if self.random.one_in(12) {
            draft.table = Some(self.a_table());
        }
        self.make(&draft);
        draft
    }

    fn make(&mut self, draft: &Draft) {
        for index in &draft.removed {
            self.model.bodies.remove(index);
        }
        for (index, b) in &draft.set {
            self.numbers += 1;
            let tag = Tag::default();
            let fresh = Body { b: *b, is_on: true, is_static: false, tag, number: self.numbers };
            self.model.bodies.entry(*index).or_insert(fresh).b = *b;
        }
        let body = |model: &mut Model, index: &u32, change: &mut dyn FnMut(&mut Body)| {
            model.bodies.get_mut(index).map(change).expect("a box");
        };
        for (index, on) in &draft.switched {
            body(&mut self.model, index, &mut |body| body.is_on = *on);
        }
        for (index, on) in &draft.statics {
            body(&mut self.model, index, &mut |body| body.is_static = *on);
        }
        for (index, tag) in &draft.tagged {
            body(&mut self.model, index, &mut |body| body.tag = *tag);
        }
        if let Some(table) = &draft.table {
            self.model.filters = table.filters().to_vec();
        }
        let Model { included, excluded, .. } = &mut self.model;
        for (list, pairs) in [(included, &draft.included), (excluded, &draft.excluded)] {
            for ([a, b], on) in pairs {
                let pair = [*a.min(b), *a.max(b)];
                if *on {
                    list.insert(pair)
                } else {
                    list.remove(&pair)
                };
            }
        }
    }
}

/// Boxes that an edit names, as far as pairs of moved boxes are told for them.
fn named(draft: &Draft) -> BTreeSet<u32> {
    let mut named: BTreeSet<u32> = draft.set.iter().map(|(index, _)| *index).collect();
    named.extend(draft.switched.iter().map(|(index, _)| *index));
    named
}

/// Hands the steps of an edit to `edit`.
fn with_steps<R>(draft: &Draft, edit: impl FnOnce(&[Step<'_>]) -> R) -> R {
    let (indices, boxes): (Vec<u32>, Vec<Aabb>) = draft.set.iter().copied().unzip();
    let (tagged, tags): (Vec<u32>, Vec<Tag>) = draft.tagged.iter().copied().unzip();
    let mut steps = vec![
        Step::Remove((&draft.removed).into()),
        Step::Set(Sets { indices: (&indices).into(), boxes: &boxes }),
    ];
    for (index, on) in &draft.switched {
        steps.push(Step::Switch(std::slice::from_ref(index).into(), *on));
    }
    for (index, on) in &draft.statics {
        steps.push(Step::Static(std::slice::from_ref(index).into(), *on));
    }
    if !tags.is_empty() {
        steps.push(Step::Tag(Tags { indices: (&tagged).into(), tags: &tags }));
    }
    steps.extend(draft.table.as_ref().map(Step::Filters));
    for (pair, on) in &draft.included {
        steps.push(Step::Include(std::slice::from_ref(pair), *on));
    }
    for (pair, on) in &draft.excluded {
        steps.push(Step::Exclude(std::slice::from_ref(pair), *on));
    }
    edit(&steps)
}

/// What a scene told, whoever keeps it.
#[derive(Clone, Debug, Default)]
pub struct ToldPairs {
    /// Whether `pairs` holds all pairs in place of changes.
    pub is_resync: bool,
    /// What began.
    pub begun: Vec<Pair>,
    /// What ended.
    pub ended: Vec<Ended>,
    /// Pairs of now.
    pub pairs: Vec<Pair>,
    /// Their number, where it is told.
    pub pair_count: Option<u64>,
}

impl From<&Told> for ToldPairs {
    fn from(told: &Told) -> Self {
        Self {
            is_resync: told.is_resync(),
            begun: told.begun().to_vec(),
            ended: told.ended().to_vec(),
            pairs: told.pairs().to_vec(),
            pair_count: told.pair_count(),
        }
    }
}

/// A scene with rules.
pub trait RuledScene {
    /// Applies an edit, which is right. The answer is taken or not.
    fn edit(&mut self, steps: &[Step<'_>], want: Want, takes: bool) -> ToldPairs;
    /// Forgets what was told.
    fn lose(&mut self);
}

impl RuledScene for Scene {
    fn edit(&mut self, steps: &[Step<'_>], want: Want, takes: bool) -> ToldPairs {
        let told = Self::edit(self, Edit { steps }, want).expect("a right edit").into();
        if takes {
            self.take();
        }
        told
    }

    fn lose(&mut self) {
        Self::lose(self);
    }
}

/// What random edits are like.
#[derive(Clone, Copy, Debug)]
pub struct EditsLike {
    /// Where chance begins.
    pub seed: u64,
    /// Indices are below this.
    pub limit: u32,
    /// How large the world is, in quarters.
    pub extent: u32,
    /// Changes of an edit, at most.
    pub changes: u32,
    /// Edits.
    pub edits: u32,
}

/// Compares lists, of which it shows the first difference.
fn assert_same<T: PartialEq + std::fmt::Debug>(found: &[T], expected: &[T], context: &str) {
    let differs =
        (0..found.len().max(expected.len())).find(|at| found.get(*at) != expected.get(*at));
    if let Some(at) = differs {
        panic!("{:?} in place of {:?} at {at}, {context}", found.get(at), expected.get(at));
    }
}

/// Makes random edits and compares every answer. Returns how often each reason was told.
///
/// # Panics
/// Where a pair is missing, extra, told twice or never, or ends for another reason.
pub fn check_scene(scene: &mut impl RuledScene, like: EditsLike) -> [u32; 3] {
    let EditsLike { seed, limit, extent, changes, edits } = like;
    let mut world =
        FilteredWorld { model: Model::default(), random: Random(seed), numbers: 0, limit, extent };
    let mut known = BTreeMap::new();
    let mut reasons = [0; 3];
    for step in 0..edits {
        // The scene begins without rules.
        let draft = if step < 3 {
            let mut draft = world.draw(0);
            draft.table = None;
            world.model.filters.clear();
            let boxes: Vec<(u32, Aabb)> = (0..limit / 2).map(|i| (2 * i, world.a_box())).collect();
            draft.set = boxes;
            draft.statics = (0..limit / 2).filter(|i| i % 3 == 0).map(|i| (2 * i, true)).collect();
            world.make(&draft);
            draft
        } else {
            world.draw(changes)
        };
        let want = match world.random.below(8) {
            0 => Want::All,
            1 => Want::Moved,
            2 => Want::Nothing,
            _ => Want::Changes,
        };
        let takes = !world.random.one_in(4);
        let told = with_steps(&draft, |steps| scene.edit(steps, want, takes));
        let now = world.model.pairs();
        let context = format!("seed {seed}, edit {step}, {want:?}");
        match want {
            Want::Changes if !told.is_resync => {
                let stays = |pair: &Pair| known.get(pair) == now.get(pair);
                let begun: Vec<Pair> = now.keys().filter(|pair| !stays(pair)).copied().collect();
                assert_same(&told.begun, &begun, &format!("begun, {context}"));
                let ended: Vec<(Pair, EndReason)> = known
                    .iter()
                    .filter(|(pair, _)| !stays(pair))
                    .map(|(pair, numbers)| (*pair, world.model.reason(*pair, *numbers)))
                    .collect();
                let found: Vec<(Pair, EndReason)> =
                    told.ended.iter().map(|ended| (ended.pair, ended.reason)).collect();
                assert_same(&found, &ended, &format!("ended, {context}"));
                for (_, reason) in found {
                    reasons[reason as usize] += 1;
                }
            }
            Want::Changes | Want::All => assert!(now.keys().eq(&told.pairs), "all, {context}"),
            Want::Moved => {
                let (pairs, named) = (&told.pairs, named(&draft));
                let must = |pair: &&Pair| named.contains(&pair[0]) || named.contains(&pair[1]);
                for pair in now.keys().filter(must) {
                    assert!(pairs.binary_search(pair).is_ok(), "{pair:?} is missing, {context}");
                }
                assert!(pairs.iter().all(|pair| now.contains_key(pair)), "moved, {context}");
            }
            _ => {}
        }
        if matches!(want, Want::Changes | Want::All) {
            assert_eq!(told.pair_count, Some(now.len() as u64), "count, {context}");
            if takes {
                known = now;
            }
        }
        if world.random.one_in(40) {
            scene.lose();
            known.clear();
            let told = scene.edit(&[], Want::Changes, true);
            assert!(told.is_resync || told.pair_count == Some(0), "{context}");
            known = world.model.pairs();
        }
    }
    reasons
}
