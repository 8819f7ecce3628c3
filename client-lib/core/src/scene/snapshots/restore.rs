//! The way back to a snapshot: phases, each an edit and what follows.

use std::collections::{HashMap, HashSet};

use super::super::edit::{Edit, FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};
use super::super::pair_list::Pair;
use super::super::snapshot::{BoxSnapshot, HistorySnapshot};
use super::super::store::are_same;
use super::log::Delta;
use super::{History, Replicas, SnapshotId, Snapshots, UnknownSnapshot};
use crate::aabb::Aabb;
use crate::filters::{FilterData, FilterTable, Listed, Rules};

/// How often the box of an index was removed while there were snapshots: by numbers that never come again, so that one
/// that was gone back to differs from those that followed.
#[derive(Debug, Default)]
pub(super) struct Incarnations {
    of: Vec<u32>,
    last: u32,
}

impl Incarnations {
    pub fn of(&self, index: u32) -> u32 {
        self.of.get(index as usize).copied().unwrap_or(0)
    }

    fn set(&mut self, index: u32, incarnation: u32) {
        if self.of(index) != incarnation {
            self.of.resize(self.of.len().max(index as usize + 1), 0);
            self.of[index as usize] = incarnation;
        }
    }

    pub fn renew(&mut self, index: u32) {
        self.last = self.last.wrapping_add(1);
        self.set(index, self.last);
    }

    pub const fn allocated_bytes(&self) -> usize {
        self.of.capacity() * size_of::<u32>()
    }
}

impl Replicas<'_> {
    pub(super) fn rules(&self) -> &Rules {
        self.now.states().filters.rules()
    }
}

/// What follows a phase's edit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AfterPhase {
    /// Nothing: what has changed is to be reported.
    #[default]
    Nothing,
    /// The pairs of now count as reported, so many.
    MarkReported(u64),
    /// The next changes are a resync.
    Resync,
}

/// A phase of the way back: an edit, and what follows.
#[derive(Debug, Default)]
pub struct RestorePhase {
    then: AfterPhase,
    /// The boxes that it leads to, unless they are those of the snapshot: the last phase.
    target: Option<Delta>,
    removed: Vec<u32>,
    set: Boxes,
    sent: Option<Boxes>,
    enabled: [Vec<u32>; 2],
    made_static: [Vec<u32>; 2],
    filtered: Vec<u32>,
    filter_data: Vec<FilterData>,
    marked: Vec<u32>,
    user_data: Vec<UserData>,
    table: Option<FilterTable>,
    included: [Vec<Pair>; 2],
    excluded: [Vec<Pair>; 2],
}

#[derive(Debug, Default)]
struct Boxes {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
}

impl Boxes {
    fn push(&mut self, index: u32, b: Aabb) {
        self.indices.push(index);
        self.boxes.push(b);
    }
}

impl RestorePhase {
    /// What follows the edit.
    pub const fn then(&self) -> AfterPhase {
        self.then
    }

    /// The edit of the boxes as they were set.
    pub fn steps(&self) -> Vec<Step<'_>> {
        self.steps_of(&self.set)
    }

    /// The edit of the boxes as they were sent.
    pub fn sent_steps(&self) -> Vec<Step<'_>> {
        self.steps_of(self.sent.as_ref().unwrap_or(&self.set))
    }

    fn steps_of<'a>(&'a self, set: &'a Boxes) -> Vec<Step<'a>> {
        let list = |list: &'a Vec<u32>| Indices::List(list);
        let mut steps = vec![
            Step::Remove(list(&self.removed)),
            Step::Set(Sets { indices: list(&set.indices), boxes: &set.boxes }),
        ];
        for on in [false, true] {
            steps.push(Step::Enable(list(&self.enabled[usize::from(on)]), on));
            steps.push(Step::Static(list(&self.made_static[usize::from(on)]), on));
        }
        let (indices, filter_data) = (list(&self.filtered), &self.filter_data[..]);
        steps.push(Step::FilterData(FilterDataSets { indices, filter_data }));
        let (indices, user_data) = (list(&self.marked), &self.user_data[..]);
        steps.push(Step::UserData(UserDataSets { indices, user_data }));
        steps.extend(self.table.as_ref().map(Step::Filters));
        for on in [false, true] {
            steps.push(Step::Include(&self.included[usize::from(on)], on));
            steps.push(Step::Exclude(&self.excluded[usize::from(on)], on));
        }
        steps.retain(|step| match step {
            Step::Include(pairs, _) | Step::Exclude(pairs, _) => !pairs.is_empty(),
            step => step.indices().is_none_or(|indices| !indices.is_empty()),
        });
        steps
    }

    /// From the boxes as they are to a target. Where `renews`, boxes that are others of the same index are removed
    /// first, so that their pairs end and begin.
    fn to(
        target: &Delta,
        replicas: &Replicas<'_>,
        incarnations: &Incarnations,
        renews: bool,
    ) -> Self {
        let mut phase = Self { sent: replicas.sent.map(|_| Boxes::default()), ..Self::default() };
        // By index, as boxes lie that are near each other.
        let mut order: Vec<[u32; 2]> =
            (0..).zip(&target.boxes).map(|(at, (index, _))| [*index, at]).collect();
        order.sort_unstable();
        for at in order.into_iter().map(|[_, at]| at as usize) {
            let (index, record) = target.boxes[at];
            let is = replicas.now.snapshot(index);
            let Some(record) = record else {
                phase.removed.extend(is.map(|_| index));
                continue;
            };
            let is_another = renews && incarnations.of(index) != record.incarnation;
            let stays = is.filter(|_| !is_another);
            if is.is_some() && is_another {
                phase.removed.push(index);
            }
            phase.change(index, &record.set, stays);
            if let (Some(to), Some(sent), Some(is)) =
                (&mut phase.sent, target.sent.get(at), replicas.sent)
                && !is.get(index).is_some_and(|is| stays.is_some() && are_same(&is, sent))
            {
                to.push(index, *sent);
            }
        }
        phase.change_rules(target, replicas.rules());
        phase
    }

    /// Makes the box of an index another one. `stays` is the one that it has, unless that is removed.
    fn change(&mut self, index: u32, to: &BoxSnapshot, stays: Option<BoxSnapshot>) {
        let BoxSnapshot { b, is_on, filter_data, user_data } = *to;
        if stays.is_none_or(|is| !are_same(&is.b, &b)) {
            self.set.push(index, b);
        }
        let of_none = FilterData::default();
        let inserted = BoxSnapshot { b, is_on: true, filter_data: of_none, user_data: 0 };
        let is = stays.unwrap_or(inserted);
        if is.is_on != is_on {
            self.enabled[usize::from(is_on)].push(index);
        }
        if is.is_static() != to.is_static() {
            self.made_static[usize::from(to.is_static())].push(index);
        }
        // Static flags have a step of their own.
        if is.filter_data.with_static(false) != filter_data.with_static(false) {
            self.filtered.push(index);
            self.filter_data.push(filter_data);
        }
        if is.user_data != user_data {
            self.marked.push(index);
            self.user_data.push(user_data.into());
        }
    }

    fn change_rules(&mut self, target: &Delta, rules: &Rules) {
        self.table = target.table.clone().filter(|table| *table != rules.table);
        let removed: HashSet<u32> = self.removed.iter().copied().collect();
        // Entries end with the boxes that are removed, also those of the target.
        let mut listed: HashMap<Pair, Listed> = rules.lists.naming(&self.removed).collect();
        listed.extend(&target.listed);
        let mut listed: Vec<(Pair, Listed)> = listed.into_iter().collect();
        listed.sort_unstable_by_key(|(pair, _)| *pair);
        for (pair, to) in listed {
            let ends = pair.iter().any(|index| removed.contains(index));
            let is = if ends { Listed::default() } else { rules.lists.listed(pair[0], pair[1]) };
            if is.is_included != to.is_included {
                self.included[usize::from(to.is_included)].push(pair);
            }
            if is.is_excluded != to.is_excluded {
                self.excluded[usize::from(to.is_excluded)].push(pair);
            }
        }
    }
}

impl Snapshots {
    /// Begins to go back to a snapshot: the phases are [asked for](Self::next_phase) one by one.
    ///
    /// # Errors
    /// [`UnknownSnapshot`].
    pub fn begin_restore(
        &mut self,
        id: SnapshotId,
        replicas: &Replicas<'_>,
    ) -> Result<(), UnknownSnapshot> {
        if self.nodes.get(&id).is_none_or(|node| node.history.is_none()) {
            return Err(UnknownSnapshot { id });
        }
        let mut way = vec![id];
        while let Some(next) = way.last().and_then(|id| self.nodes.get(id)?.next) {
            way.push(next);
        }
        if way.len() > 1 {
            self.part_since();
        }
        // From the end: each becomes the next one of the one that was its next.
        for pair in way.windows(2).rev() {
            let [here, later] = [pair[0], pair[1]];
            let Some(node) = self.nodes.get_mut(&here) else { continue };
            let mut before = std::mem::take(&mut node.before);
            (node.next, self.head) = (None, Some(here));
            node.previous.push(later);
            self.log.swap(&mut before, replicas, &self.incarnations);
            if let Some(node) = self.nodes.get_mut(&later) {
                (node.before, node.next) = (before, Some(here));
                node.previous.retain(|previous| *previous != here);
            }
            self.let_go(later);
        }
        Ok(())
    }

    /// The first phase to the last snapshot on the way, or the second one.
    fn phase_to(&mut self, replicas: &Replicas<'_>, is_first: bool) -> RestorePhase {
        let Self { nodes, places, log, incarnations, .. } = self;
        let history = self.head.and_then(|head| nodes.get(&head)?.history.as_ref());
        let by_way_of = |target: Delta, count| {
            let phase = RestorePhase::to(&target, replicas, incarnations, false);
            RestorePhase { then: AfterPhase::MarkReported(count), target: Some(target), ..phase }
        };
        let to_snapshot = |then, renews| {
            let phase = RestorePhase::to(log.delta(), replicas, incarnations, renews);
            RestorePhase { then, ..phase }
        };
        match (history, is_first) {
            (Some(History::Reported(count, since)), true) if since.is_empty() => {
                to_snapshot(AfterPhase::MarkReported(*count), false)
            }
            (Some(History::Reported(count, since)), true) => {
                by_way_of(since.clone().then(log.delta().clone(), places), *count)
            }
            (Some(History::Unreported), true) if self.history != HistorySnapshot::Unreported => {
                let all = (0..replicas.now.index_end()).map(|index| (index, None));
                by_way_of(Delta { boxes: all.collect(), ..Delta::default() }, 0)
            }
            (Some(History::Lost), true) => to_snapshot(AfterPhase::Resync, false),
            _ => to_snapshot(AfterPhase::Nothing, true),
        }
    }

    /// The phases of the way back that was [begun](Self::begin_restore): the first one, or the one after another.
    pub fn next_phase(
        &mut self,
        replicas: &Replicas<'_>,
        last: Option<&RestorePhase>,
    ) -> Option<RestorePhase> {
        match last {
            Some(phase) if phase.target.is_none() => None,
            last => Some(self.phase_to(replicas, last.is_none())),
        }
    }

    /// Notes the edit of a phase that is about to be applied: what the boxes of the snapshot are.
    pub fn note_phase(&mut self, phase: &RestorePhase, replicas: &Replicas<'_>) {
        if let Some(target) = &phase.target {
            // Also those that stay what they are: they are another incarnation, or were sent otherwise.
            self.log.note_boxes(target, replicas, &self.incarnations);
            let steps = phase.steps();
            self.log.note(Edit { steps: &steps }, replicas, &self.incarnations);
        }
    }

    /// Notes that the edit of a phase was applied, which was [noted](Self::note_phase) before.
    pub fn end_phase(&mut self, phase: &RestorePhase) {
        for (index, record) in &phase.target.as_ref().unwrap_or(self.log.delta()).boxes {
            match record {
                Some(record) => self.incarnations.set(*index, record.incarnation),
                None => self.incarnations.renew(*index),
            }
        }
        match phase.then() {
            AfterPhase::MarkReported(count) => self.acknowledge(count),
            AfterPhase::Resync => self.resync(),
            AfterPhase::Nothing => {}
        }
        if phase.target.is_some() {
            return;
        }
        self.log.clear();
        let history = self.head.and_then(|head| self.nodes.get(&head)?.history.as_ref());
        let since = match history {
            Some(History::Reported(_, since)) => since.clone(),
            _ => Delta::default(),
        };
        self.has_changed = !since.is_empty();
        self.is_since_in_log = since.is_empty();
        self.since.put(since);
        if matches!(history, Some(History::Unreported)) {
            self.history = HistorySnapshot::Unreported;
        }
    }
}
