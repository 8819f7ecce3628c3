//! Collision filters of a scene: those of now, and those of when the history began.
//!
//! Whether two boxes are a pair is decided from their states: place, validity, enabled, static, filter data,
//! entries in pair lists, and the incarnation of the index. Geometry and stillness are the search's; the rest is
//! decided here, for then and for now, by the one order of [`filters`](crate::filters). An edit marks each box
//! whose filter data changes, so that the search looks around it like around a box that has moved.
//!
//! A search never reports two boxes that are **still**: static by flag or filter, and named by no list. So static
//! worlds cost nothing, and rules that a list makes an exception to are decided pair by pair.

use std::collections::HashMap;

use super::edit::{Edit, Flag, Step};
use super::pair_list::Pair;
use super::states::{BoxStates, PRESENT, STILL};
use crate::filters::{
    FilterData, FilterId, FilterTable, Listed, PairLists, Rules, decide, in_order,
};

/// The boxes whose filter data an edit changes, as the search for their pairs keeps them.
pub trait FilteredBoxes {
    /// Their states.
    fn states(&self) -> &BoxStates;
    /// Their states.
    fn states_mut(&mut self) -> &mut BoxStates;
    /// The edit names a box: its pairs are those of [`Report::Moved`](super::Report::Moved).
    fn name(&mut self, _: u32) {}
    /// Enables or disables a box.
    fn enable(&mut self, index: u32, on: bool) {
        self.states_mut().enable(index, on);
    }
    /// The stillness of a box is about to change.
    fn change(&mut self, _: u32) {}
    /// Filter data of a box change: its pairs are to be decided anew.
    fn refilter(&mut self, _: u32) {}
    /// Around which of two boxes fewer others lie, as far as that is known.
    fn smaller(&self, pair: [u32; 2]) -> u32 {
        pair[0]
    }
}

/// Nobody searches here: what changes is only kept.
impl FilteredBoxes for BoxStates {
    fn states(&self) -> &Self {
        self
    }

    fn states_mut(&mut self) -> &mut Self {
        self
    }
}

/// Does what an edit says of flags, rules and user data, after its removals and sets.
pub fn apply_rules(edit: Edit<'_>, boxes: &mut impl FilteredBoxes) {
    let mut filters = std::mem::take(&mut boxes.states_mut().filters);
    edit.for_each_flag(|index, flag| {
        boxes.name(index);
        match flag {
            Flag::On(on) => boxes.enable(index, on),
            Flag::Static(on) => filters.make_static(index, on, boxes),
        }
    });
    filters.apply(edit, boxes);
    boxes.states_mut().filters = filters;
    boxes.states_mut().set_user_data(edit);
}

/// Filter data of a scene, now and when the history began.
#[derive(Clone, Debug, Default)]
pub struct FilterHistory {
    now: Rules,
    /// Whether an edit ever gave filter data. Until then no box has any, and stillness is the static flag.
    is_used: bool,
    then: Then,
}

/// What differs from now of the filter data when the history began.
#[derive(Clone, Debug, Default)]
struct Then {
    is_used: bool,
    filter_data: HashMap<u32, FilterData>,
    table: Option<FilterTable>,
    listed: HashMap<Pair, Listed>,
}

impl FilterHistory {
    /// The filter data of now.
    pub const fn rules(&self) -> &Rules {
        &self.now
    }

    /// Whether an edit ever gave filter data.
    #[inline]
    pub const fn is_used(&self) -> bool {
        self.is_used
    }

    /// The filter data of a box, with its own static flag. `is_still` is its stillness.
    pub fn filter_data(&self, index: u32, is_still: bool) -> FilterData {
        if self.is_used {
            self.now.filter_data(index)
        } else {
            FilterData::default().with_static(is_still)
        }
    }

    /// Whether the boxes of two indices may be a pair that are not both still.
    #[inline]
    pub fn meet(&self, [a, b]: [u32; 2]) -> bool {
        !self.is_used || self.now.meet(a, b)
    }

    /// Whether they could when the history began.
    #[inline]
    pub fn met(&self, [a, b]: [u32; 2]) -> bool {
        let Then { is_used, filter_data, table, listed } = &self.then;
        if !is_used {
            return true;
        }
        if filter_data.is_empty() && table.is_none() && listed.is_empty() {
            return self.now.meet(a, b);
        }
        let filter_data =
            |index| filter_data.get(&index).copied().unwrap_or_else(|| self.now.filter_data(index));
        let lists = || {
            let then = listed.get(&in_order([a, b])).copied();
            then.unwrap_or_else(|| self.now.lists.listed(a, b))
        };
        decide(&filter_data(a), &filter_data(b), table.as_ref().unwrap_or(&self.now.table), lists)
    }

    /// The history begins anew.
    pub fn discard(&mut self) {
        self.then = Then { is_used: self.is_used, ..Then::default() };
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let then = &self.then;
        self.now.allocated_bytes()
            + then.filter_data.capacity() * (size_of::<(u32, FilterData)>() + 1)
            + then.table.as_ref().map_or(0, FilterTable::allocated_bytes)
            + then.listed.capacity() * (size_of::<(Pair, Listed)>() + 1)
    }

    /// The box of an index is removed: the next one has filter data of its own.
    pub fn remove(&mut self, index: u32) {
        if !self.is_used {
            return;
        }
        self.set_filter_data(index, FilterData::default());
        let Self { now, then, .. } = self;
        now.lists.remove_index(index, |pair, listed| then.note_listed(pair, listed));
    }

    /// Makes a box static or not.
    fn make_static(&mut self, index: u32, on: bool, boxes: &mut impl FilteredBoxes) {
        if !self.is_used {
            return set_still(index, on, boxes);
        }
        let filter_data = self.now.filter_data(index);
        if filter_data.is_static() != on {
            boxes.refilter(index);
            self.set_filter_data(index, filter_data.with_static(on));
            self.settle(index, boxes);
        }
    }

    /// Does what an edit says of rules, after all that it does to boxes.
    fn apply(&mut self, edit: Edit<'_>, boxes: &mut impl FilteredBoxes) {
        if edit.has_rules() {
            self.apply_rules(edit, boxes);
        }
        // Boxes that are inserted have the first filter.
        if self.is_used && self.now.table.get(FilterId::default()).is_static {
            edit.for_each_set(|index, _| self.settle(index, boxes));
        }
    }

    fn apply_rules(&mut self, edit: Edit<'_>, boxes: &mut impl FilteredBoxes) {
        if edit.gives_filter_data() {
            self.begin(boxes);
        }
        edit.for_each_filter_data(|index, filter_data| {
            boxes.name(index);
            let was = self.now.filter_data(index);
            let filter_data = filter_data.with_static(was.is_static());
            if filter_data != was {
                boxes.refilter(index);
                self.set_filter_data(index, filter_data);
                self.settle(index, boxes);
            }
        });
        for step in edit.steps {
            match step {
                Step::Filters(table) => self.set_table(table, boxes),
                Step::Include(pairs, on) => {
                    self.list(pairs, boxes, |lists, pair| lists.include(pair, *on));
                }
                Step::Exclude(pairs, on) => {
                    self.list(pairs, boxes, |lists, pair| lists.exclude(pair, *on));
                }
                _ => {}
            }
        }
    }

    /// From now on filter data say which boxes are static.
    fn begin(&mut self, boxes: &mut impl FilteredBoxes) {
        if std::mem::replace(&mut self.is_used, true) {
            return;
        }
        for index in 0..boxes.states().index_end() as u32 {
            if !boxes.states().has(index, STILL) {
                continue;
            }
            self.set_filter_data(index, FilterData::default().with_static(true));
            // A list may make it move again for searches, while it is static from this history on.
            if boxes.states().has_flipped(index) {
                boxes.refilter(index);
            }
        }
    }

    /// Makes a box as still as its filter data say.
    fn settle(&self, index: u32, boxes: &mut impl FilteredBoxes) {
        if !self.is_used {
            return;
        }
        let filter_data = self.now.filter_data(index);
        let is_static = filter_data.is_static() || self.now.table.get(filter_data.filter).is_static;
        let is_still = is_static && !self.now.lists.is_named(index);
        set_still(index, is_still, boxes);
    }

    fn set_filter_data(&mut self, index: u32, filter_data: FilterData) {
        let was = self.now.filter_data(index);
        if was == filter_data {
            return;
        }
        if self.then.is_used {
            self.then.filter_data.entry(index).or_insert(was);
        }
        let len = index as usize + 1;
        if self.now.filter_data.len() < len {
            self.now.filter_data.resize(len, FilterData::default());
        }
        self.now.filter_data[index as usize] = filter_data;
    }

    fn set_table(&mut self, table: &FilterTable, boxes: &mut impl FilteredBoxes) {
        if *table == self.now.table {
            return;
        }
        let named = self.named_by(table, boxes.states());
        let was = std::mem::replace(&mut self.now.table, table.clone());
        if self.then.is_used {
            self.then.table.get_or_insert(was);
        }
        for index in named {
            boxes.name(index);
            boxes.refilter(index);
            self.settle(index, boxes);
        }
    }

    /// Boxes whose filter is another one by a new table.
    pub(super) fn named_by(&self, table: &FilterTable, states: &BoxStates) -> Vec<u32> {
        let now = &self.now.table;
        let differs: Vec<bool> = (0..table.filters().len().max(now.filters().len()))
            .map(|id| FilterId(id as u16))
            .map(|id| table.get(id) != now.get(id))
            .collect();
        let differs = |index: &u32| {
            let filter = usize::from(self.now.filter_data(*index).filter.0);
            states.has(*index, PRESENT) && differs.get(filter).copied().unwrap_or(false)
        };
        (0..states.index_end() as u32).filter(differs).collect()
    }

    fn list(
        &mut self,
        pairs: &[[u32; 2]],
        boxes: &mut impl FilteredBoxes,
        put: impl Fn(&mut PairLists, [u32; 2]) -> bool,
    ) {
        for &pair in pairs {
            let listed = self.now.lists.listed(pair[0], pair[1]);
            let differs = put(&mut self.now.lists, pair);
            if differs {
                self.then.note_listed(in_order(pair), listed);
            }
            let present = pair.map(|index| boxes.states().has(index, PRESENT));
            if differs && present == [true; 2] {
                // The pair is found from either.
                boxes.refilter(boxes.smaller(pair));
            }
            for (index, _) in pair.into_iter().zip(present).filter(|(_, is_present)| *is_present) {
                boxes.name(index);
                self.settle(index, boxes);
            }
        }
    }
}

/// Makes a box still or not.
fn set_still(index: u32, is_still: bool, boxes: &mut impl FilteredBoxes) {
    if boxes.states().has(index, STILL) != is_still {
        boxes.change(index);
        boxes.states_mut().set_still(index, is_still);
    }
}

impl Then {
    fn note_listed(&mut self, pair: Pair, listed: Listed) {
        if self.is_used {
            self.listed.entry(pair).or_insert(listed);
        }
    }
}

/// Takes out of sorted lists what may not be, or might not then, and what ended and began again without being
/// another pair: for a search that knows of changed filter data only whose pairs to report as both.
pub fn decide_changes(
    filters: &FilterHistory,
    is_replaced: impl Fn([u32; 2]) -> bool,
    begun: &mut Vec<[u32; 2]>,
    ended: &mut Vec<super::Ended>,
) {
    begun.retain(|pair| filters.meet(*pair));
    ended.retain(|ended| filters.met(ended.pair));
    let mut stays = Vec::with_capacity(begun.len());
    let mut at = 0;
    ended.retain(|this| {
        while begun.get(at).is_some_and(|pair| *pair < this.pair) {
            stays.push(begun[at]);
            at += 1;
        }
        let cancels = begun.get(at) == Some(&this.pair) && !is_replaced(this.pair);
        at += usize::from(cancels);
        !cancels
    });
    stays.extend_from_slice(&begun[at..]);
    *begun = stays;
}
