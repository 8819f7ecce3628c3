//! From an edit that changes rules to one that any scene understands, and that says which rules changed.
//!
//! A pair begins or ends as rules change, although no box has moved. So a box of which rules have changed
//! is removed and set again, where it was: the scene below finds all its pairs of then as ended and all its
//! pairs of now as begun, whatever engine it has, and who keeps the rules tells those that changed.
//!
//! Static boxes that no list names are static for the scene below too, which never looks for their pairs.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use super::super::edit::{Edit, Flag, Indices, Sets, Step, Tags};
use super::super::kept::KeptBox;
use crate::aabb::Aabb;
use crate::filters::{FilterId, FilterTable, PairLists, Rules, Tag};

/// What is added to an edit that changes rules. It borrows nothing.
#[derive(Debug, Default)]
pub struct Expansion {
    renewed: Vec<u32>,
    set: Vec<u32>,
    boxes: Vec<Aabb>,
    off: Vec<u32>,
    statics: Vec<u32>,
    tagged: Vec<u32>,
    tags: Vec<Tag>,
}

/// The boxes and rules that an edit changes.
pub(in crate::scene) struct Before<'a, K> {
    /// The box of an index.
    pub kept: K,
    /// Boxes have indices below this.
    pub index_end: u32,
    /// `None` where no edit was about rules yet.
    pub rules: Option<&'a Rules>,
}

/// What an edit says of the boxes that its rules are about.
#[derive(Default)]
struct Said {
    removed: HashSet<u32>,
    set: HashSet<u32>,
    tags: BTreeMap<u32, Tag>,
    statics: BTreeMap<u32, bool>,
}

impl Expansion {
    /// What an edit needs; `None` where it is to be made as it is. The edit is right, and is not made yet.
    pub(in crate::scene) fn of<K: Fn(u32) -> Option<KeptBox>>(
        edit: Edit<'_>,
        before: &Before<'_, K>,
    ) -> Option<Self> {
        let is_about = |step: &Step<'_>| step.is_rule() || matches!(step, Step::Static(..));
        if !edit.has_rules() && (before.rules.is_none() || !edit.steps.iter().any(is_about)) {
            return None;
        }
        let empty = Rules::default();
        let old = before.rules.unwrap_or(&empty);
        let table = edit.steps.iter().rev().find_map(|step| match step {
            Step::Filters(table) => Some(*table),
            _ => None,
        });
        let table = table.unwrap_or(&old.table);
        let (forced, listed) = changed_rules(edit, before, old, table);
        let mut said = Said::default();
        edit.for_each_tag(|index, tag| {
            said.tags.insert(index, tag);
        });
        edit.for_each_flag(|index, flag| {
            if let Flag::Static(on) = flag {
                said.statics.insert(index, on);
            }
        });
        let mut touched: BTreeSet<u32> = forced.iter().chain(&listed).copied().collect();
        touched.extend(said.tags.keys().chain(said.statics.keys()));
        if before.rules.is_none() {
            // From now on the rules know what is static.
            let is_static = |index: &u32| (before.kept)(*index).is_some_and(|kept| kept.is_static);
            touched.extend((0..before.index_end).filter(is_static));
        }
        edit.for_each_removed(|index| {
            said.removed.insert(index);
        });
        for sets in edit.sets() {
            sets.indices.for_each(|_, index| {
                if touched.contains(&index) {
                    said.set.insert(index);
                }
            });
        }
        let named = |index: u32| old.lists.is_named(index) || listed.contains(&index);
        let mut this = Self::default();
        for &index in &touched {
            let kept = (before.kept)(index).filter(|_| !said.removed.contains(&index));
            if kept.is_none() && !said.set.contains(&index) {
                continue;
            }
            let was = if kept.is_some() { old.tag(index) } else { Tag::default() };
            let is_static = said.statics.get(&index).copied();
            let is_static = is_static.unwrap_or_else(|| kept.is_some_and(|kept| kept.is_static));
            let tag = said.tags.get(&index).copied().unwrap_or(was).with_static(is_static);
            let skips = |tag: Tag, table: &FilterTable, is_named: bool| {
                !is_named && (tag.is_static() || table.get(tag.filter).is_static)
            };
            let is_skipped = skips(tag, table, named(index));
            let was_skipped = match (&kept, before.rules) {
                (None, _) => false,
                (Some(kept), None) => kept.is_static,
                (Some(_), Some(_)) => skips(was, &old.table, old.lists.is_named(index)),
            };
            let differs = tag != was && before.rules.is_some();
            let differs = differs || tag.with_static(false) != was.with_static(false);
            // A static box that a list names is not static for the scene below: that is no change of its own.
            let differs = differs || was_skipped != is_skipped || forced.contains(&index);
            let is_renewed = kept.is_some() && differs;
            if let Some(kept) = kept.filter(|_| is_renewed) {
                this.renewed.push(index);
                if !said.set.contains(&index) {
                    this.set.push(index);
                    this.boxes.push(kept.b);
                }
                if !kept.is_on {
                    this.off.push(index);
                }
            }
            if is_skipped && (is_renewed || kept.is_none()) {
                this.statics.push(index);
            }
            if tag != was {
                this.tagged.push(index);
                this.tags.push(tag);
            }
        }
        Some(this)
    }

    /// The edit, with what it needs.
    pub fn steps<'a>(&'a self, edit: Edit<'a>) -> Vec<Step<'a>> {
        fn list(indices: &[u32]) -> Indices<'_> {
            Indices::List(indices)
        }
        let own = [
            Step::Remove(list(&self.renewed)),
            Step::Set(Sets { indices: list(&self.set), boxes: &self.boxes }),
            Step::Switch(list(&self.off), false),
            Step::Static(list(&self.statics), true),
            Step::Renew(list(&self.renewed)),
            Step::Tag(Tags { indices: list(&self.tagged), tags: &self.tags }),
        ];
        let is_empty = |step: &Step<'_>| match step {
            Step::Set(Sets { indices, .. }) | Step::Tag(Tags { indices, .. }) => indices.is_empty(),
            Step::Remove(indices) | Step::Static(indices, _) | Step::Switch(indices, _) => {
                indices.is_empty()
            }
            // Without it, nobody below would know that there are rules.
            _ => false,
        };
        let theirs = |step: &&Step<'_>| !matches!(step, Step::Static(..) | Step::Tag(_));
        let theirs = edit.steps.iter().filter(theirs).copied();
        own.into_iter().filter(|step| !is_empty(step)).chain(theirs).collect()
    }
}

/// Boxes around which other rules hold than before, whatever their tags, and indices that the edit names in
/// a list.
fn changed_rules<K: Fn(u32) -> Option<KeptBox>>(
    edit: Edit<'_>,
    before: &Before<'_, K>,
    old: &Rules,
    table: &FilterTable,
) -> (HashSet<u32>, HashSet<u32>) {
    let (mut forced, mut listed) = (HashSet::new(), HashSet::new());
    if *table != old.table {
        let differs: Vec<bool> = (0..table.filters().len().max(old.table.filters().len()))
            .map(|id| FilterId(id as u16))
            .map(|id| table.get(id) != old.table.get(id))
            .collect();
        let differs = |index: &u32| {
            differs.get(usize::from(old.tag(*index).filter.0)).copied().unwrap_or(false)
        };
        forced.extend((0..before.index_end).filter(differs));
    }
    for step in edit.steps {
        let (Step::Include(pairs, _) | Step::Exclude(pairs, _)) = step else { continue };
        for [a, b] in *pairs {
            forced.insert(*a.min(b));
            listed.extend([*a, *b]);
        }
    }
    (forced, listed)
}

/// Does what an edit, with what it needs, says of rules. `note` hears of everything before it changes.
pub(in crate::scene) fn apply_rules(edit: Edit<'_>, rules: &mut Rules, note: &mut impl Note) {
    let mut renewed = HashSet::new();
    for step in edit.steps {
        if let Step::Renew(indices) = step {
            indices.for_each(|_, index| {
                renewed.insert(index);
            });
        }
    }
    edit.for_each_removed(|index| {
        if renewed.contains(&index) {
            note.renewed(index);
        } else {
            note.removed(index, rules.tag(index));
            if let Some(tag) = rules.tags.get_mut(index as usize) {
                *tag = Tag::default();
            }
        }
    });
    edit.for_each_tag(|index, tag| {
        note.tagged(index, rules.tag(index));
        let len = index as usize + 1;
        if rules.tags.len() < len {
            rules.tags.resize(len, Tag::default());
        }
        rules.tags[index as usize] = tag;
    });
    for step in edit.steps {
        match step {
            Step::Filters(table) => {
                note.table(std::mem::replace(&mut rules.table, (*table).clone()));
            }
            Step::Include(pairs, on) => pairs.iter().for_each(|pair| {
                note.listed(*pair, &rules.lists);
                rules.lists.include(*pair, *on);
            }),
            Step::Exclude(pairs, on) => pairs.iter().for_each(|pair| {
                note.listed(*pair, &rules.lists);
                rules.lists.exclude(*pair, *on);
            }),
            _ => {}
        }
    }
}

/// Who hears what rules were before they change.
pub(in crate::scene) trait Note {
    /// A box stays what it was, and is looked at anew.
    fn renewed(&mut self, _index: u32) {}
    /// A box is removed.
    fn removed(&mut self, _index: u32, _tag: Tag) {}
    /// A box gets another tag.
    fn tagged(&mut self, _index: u32, _tag: Tag) {}
    /// All filters are replaced.
    fn table(&mut self, _table: FilterTable) {}
    /// A pair is put on a list, or taken off.
    fn listed(&mut self, _pair: [u32; 2], _lists: &PairLists) {}
}

/// Nobody.
impl Note for () {}
