//! The boxes of a shared scene: where pairs are found, and a copy of what all members have sent.

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::dispatch::StageTimes;
use pairmask_core::scene::shared::{
    Incarnations, MovedBoxes, NamedPair, Ranges, RemainingBoxes, Remains, TickChanges,
};
use pairmask_core::scene::{
    BoxSnapshot, Edit, EndReason, Report, Reported, SceneCopy, SceneError, Sets, Step,
};
use pairmask_core::{Aabb, EngineChoice};
use pairmask_transport::Share;
use pairmask_wire::{Observed, ObservedBox};

use super::SceneTools;
use crate::audit::{AuditedScene, Auditor, SceneNote};
use crate::clients::{PendingBoxes, SceneRoom};
use crate::execute::SceneHost;
use crate::publish::{OpenRequest, Outbox, Refusal};
use crate::requests::asked::Asked;
use crate::requests::scene::{Failed, bytes_of};

/// Bytes of the copy of a box, with its flags, and of the tick at which it moved.
const BYTES_A_COPY: u64 = 33;

/// All boxes, and what the edits of all members have changed.
pub(super) struct Boxes {
    engine: EngineChoice,
    /// Indices are below this.
    limit: u32,
    tools: SceneTools,
    pub(super) scene: SceneHost,
    /// All boxes: edits are checked against it, and the scene is made again from it where a device is lost.
    /// What the open tick's edits mark in it stays marked until they are applied.
    copy: SceneCopy,
    /// How many boxes each index has lost.
    incarnations: Incarnations,
    pub(super) moved: MovedBoxes,
    /// Whose user data changed at which tick.
    marked: MovedBoxes,
    /// At which tick the table of filters was given.
    filters_at: u64,
    /// The last tick.
    tick: u64,
    /// Boxes whose writers have left.
    kept: RemainingBoxes,
    room: SceneRoom,
    /// Bytes that were kept of members after the last tick.
    members_bytes: u64,
    /// Of the open tick.
    pending: Pending,
    most_pairs: u64,
    /// Memory for what queries find.
    found: Vec<[u32; 2]>,
    /// Whether the scene is to be made again before it is asked.
    is_broken: bool,
    audit: Option<TickAudit>,
}

/// The audit of the scene, while it can be followed, and the edits that were reported to it.
struct TickAudit {
    scene: AuditedScene,
    edits: u64,
}

pub(super) struct Reasons<'a> {
    copy: &'a SceneCopy,
    incarnations: &'a Incarnations,
}

impl Reasons<'_> {
    pub fn of(&self, named: NamedPair) -> EndReason {
        if self.incarnations.is_current(named) {
            self.copy.states().end_reason(named.pair)
        } else {
            EndReason::Removed
        }
    }
}

/// User data of all boxes, and whose changed at which tick.
pub(super) struct UserDataOf<'a> {
    copy: &'a SceneCopy,
    marked: &'a MovedBoxes,
}

impl UserDataOf<'_> {
    /// Indices whose user data changed after a tick, and what it is now.
    pub fn changed_after(&self, tick: u64) -> Vec<(u32, u64)> {
        let of = |index| (index, self.copy.states().user_data(index));
        self.marked.after(tick).into_iter().map(of).collect()
    }
}

/// What edits of the open tick take that were checked, and wait to be applied.
#[derive(Clone, Copy, Debug, Default)]
struct Pending {
    /// Bytes of the edits, and of rules that they add.
    bytes: u64,
    boxes: PendingBoxes,
}

impl Pending {
    fn add(&mut self, edit: Edit<'_>, bytes: u64) {
        self.bytes += bytes + edit.rule_bytes() as u64;
        self.boxes.count += edit.boxes() as u64;
        self.boxes.index_end = self.boxes.index_end.max(edit.index_end());
    }

    /// Drops one. The end of its indices stays until the tick ends.
    fn take_off(&mut self, edit: Edit<'_>, bytes: u64) {
        self.bytes = self.bytes.saturating_sub(bytes + edit.rule_bytes() as u64);
        self.boxes.count = self.boxes.count.saturating_sub(edit.boxes() as u64);
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Changed {
    /// What the scene reports.
    Reported,
    /// Nobody knows.
    Lost,
}

fn audit_edit(
    auditor: &Auditor,
    audit: &mut Option<TickAudit>,
    edit: Edit<'_>,
    reported: &Reported,
) {
    if let Some(TickAudit { scene, edits }) = audit {
        *edits += 1;
        auditor.follow(scene, || SceneNote::of_tick(*edits, edit, reported));
    }
}

impl Boxes {
    /// No boxes, whose indices are below a limit. They draw from a client's share, also when it has left.
    pub fn begin(
        limit: u32,
        engine: EngineChoice,
        tools: SceneTools,
        share: &Share,
    ) -> Result<Self, Refusal> {
        let audit = tools.auditor.draw_scene(limit);
        let counts = tools.counters.scene(0, 0);
        Ok(Self {
            audit: audit.map(|scene| TickAudit { scene, edits: 0 }),
            engine,
            limit,
            scene: tools.new_scene(limit, engine)?,
            copy: SceneCopy::new(limit),
            incarnations: Incarnations::default(),
            moved: MovedBoxes::default(),
            marked: MovedBoxes::default(),
            filters_at: 0,
            tick: 0,
            kept: RemainingBoxes::default(),
            room: SceneRoom::begin(&tools.totals, share, counts)?,
            tools,
            members_bytes: 0,
            pending: Pending::default(),
            most_pairs: u64::MAX,
            found: Vec::new(),
            is_broken: false,
        })
    }

    fn own_bytes(&self) -> u64 {
        let Self { copy, incarnations, moved, marked, found, .. } = self;
        let kept = copy.allocated_bytes() + incarnations.allocated_bytes();
        (kept + moved.allocated_bytes() + marked.allocated_bytes()) as u64 + bytes_of(found)
    }

    /// Checks a member's edit, which stays right. It is to be applied or [cancelled](Self::cancel).
    pub fn check(&mut self, edit: Edit<'_>, bytes: u64) -> Result<(), Refusal> {
        let beside = self.own_bytes() + self.members_bytes + self.pending.bytes;
        // User data are in the copy as well, and the ticks at which they changed.
        let more = bytes + BYTES_A_COPY * edit.index_end() + 2 * edit.user_data_bytes();
        self.room.make(&mut self.scene, edit, self.pending.boxes, beside + more)?;
        if let Err(error) = self.copy.check(edit) {
            self.note_bytes();
            return Err(error.into());
        }
        // Others are checked before it is applied: its boxes are not in the scene then.
        self.pending.add(edit, bytes);
        Ok(())
    }

    pub fn cancel(&mut self, edit: Edit<'_>, bytes: u64) {
        self.copy.cancel(edit);
        self.pending.take_off(edit, bytes);
    }

    /// Most pairs that later edits may find where they look for all, where an answer has room for so many.
    pub fn limit_pairs(&mut self, of_answer: u64) {
        let most = self.room.most_pairs(of_answer);
        self.most_pairs = most;
        self.scene.limit_pairs(most);
    }

    /// Notes the boxes that are removed between ticks, as of the next one.
    pub fn note_removed(&mut self, edit: Edit<'_>) {
        self.moved.note_named(self.tick + 1, edit, &self.copy);
    }

    pub fn note_moved(&mut self, tick: u64, edit: Edit<'_>) {
        self.tick = tick;
        self.moved.note_named(tick, edit, &self.copy);
        self.marked.note_marked(tick, edit, &self.copy, &self.kept);
        if edit.has_table() {
            self.filters_at = tick;
        }
    }

    /// Applies edits that were checked, by so many threads.
    pub fn apply(&mut self, edit: Edit<'_>, threads: usize) -> Result<Changed, SceneError> {
        let was_made = self.mend(threads);
        let reset = self.kept.reset_by(edit);
        let steps = reset.as_ref().map(|reset| reset.steps(edit));
        let edit = steps.as_ref().map_or(edit, |steps| Edit { steps });
        self.incarnations.apply(edit);
        let Self { scene, copy, .. } = self;
        if let Err(error) = was_made {
            // The edits are part of what it is made from next.
            copy.apply(edit);
            return Err(error);
        }
        scene.set_threads(threads);
        let mut search = || scene.edit(edit, Report::Changes);
        let edited = if threads == 1 {
            let edited = search();
            copy.apply(edit);
            edited
        } else {
            rayon::join(search, || copy.apply(edit)).0
        };
        if edited.is_err() {
            // The boxes are in the copy.
            self.note_broken();
            self.mend(threads)?;
            return Ok(Changed::Lost);
        }
        audit_edit(&self.tools.auditor, &mut self.audit, edit, self.scene.reported());
        let is_lost = was_made == Ok(true) || self.scene.reported().is_resync();
        Ok(if is_lost { Changed::Lost } else { Changed::Reported })
    }

    /// Notes that the scene missed an edit: who follows it cannot follow the next.
    fn note_broken(&mut self) {
        (self.is_broken, self.audit) = (true, None);
    }

    /// Makes the scene again from the copy, where it is broken. Whether it was.
    fn mend(&mut self, threads: usize) -> Result<bool, SceneError> {
        if !self.is_broken {
            return Ok(false);
        }
        self.scene = self.tools.new_scene(self.limit, self.engine)?;
        self.scene.set_threads(threads);
        self.scene.limit_pairs(self.most_pairs);
        let whole = self.copy.whole();
        self.scene.edit(Edit { steps: &whole.steps() }, Report::All)?;
        self.scene.acknowledge();
        self.is_broken = false;
        Ok(true)
    }

    pub fn whole(&mut self) -> Result<Arc<Vec<[u32; 2]>>, SceneError> {
        self.pairs(Edit::NONE, Report::All)
    }

    /// The pairs of now that have a box which moved after a tick.
    pub fn moved_after(&mut self, tick: u64) -> Result<Arc<Vec<[u32; 2]>>, SceneError> {
        let there = |index| Some((index, self.copy.get(index)?));
        let moved = self.moved.after(tick).into_iter().filter_map(there);
        let (indices, boxes): (Vec<u32>, Vec<Aabb>) = moved.unzip();
        // They stay what they are: that names them.
        let sets = Sets { indices: (&indices).into(), boxes: &boxes };
        self.pairs(Edit { steps: &[Step::Set(sets)] }, Report::Moved)
    }

    /// The pairs that an edit reports which changes nothing.
    fn pairs(&mut self, edit: Edit<'_>, report: Report) -> Result<Arc<Vec<[u32; 2]>>, SceneError> {
        match self.scene.edit(edit, report) {
            Ok(()) => {
                let reported = self.scene.reported();
                let pairs = Arc::new(reported.pairs().to_vec());
                audit_edit(&self.tools.auditor, &mut self.audit, edit, reported);
                self.scene.acknowledge();
                Ok(pairs)
            }
            Err(error) => {
                self.note_broken();
                Err(error)
            }
        }
    }

    /// Answers a query or a cast.
    pub fn ask(
        &mut self,
        open: &mut OpenRequest,
        asked: Asked<'_>,
        threads: usize,
        outbox: &Outbox,
    ) -> Result<(), Refusal> {
        self.mend(threads)?;
        let mut answered = self.answer(open, asked, threads, outbox);
        if let Err(Failed::Lost(_)) = answered {
            // Its boxes were in the memory of a device that is lost.
            self.note_broken();
            self.mend(threads)?;
            answered = self.answer(open, asked, threads, outbox);
        }
        if self.pending.bytes == 0 {
            self.note_bytes();
        }
        answered.map_err(|(Failed::Refused(refusal) | Failed::Lost(refusal))| refusal)
    }

    fn answer(
        &mut self,
        open: &mut OpenRequest,
        asked: Asked<'_>,
        threads: usize,
        outbox: &Outbox,
    ) -> Result<(), Failed> {
        let Self { scene, found, audit, .. } = self;
        let audited = audit.as_ref().map(|audit| &audit.scene);
        asked.answer((scene, found, audited), open, threads, outbox)
    }

    pub fn changes(&self) -> TickChanges {
        TickChanges::of(self.scene.reported(), &self.incarnations)
    }

    /// All indices with boxes are below it.
    pub const fn index_end(&self) -> usize {
        self.copy.index_end()
    }

    /// Filters of the table.
    pub fn filters(&self) -> usize {
        self.copy.filter_table().filters().len()
    }

    /// What became of boxes after a tick; of all, where it is 0, or none of this scene's.
    pub fn observed_after(&self, after: u64) -> Observed {
        let is_whole = after == 0 || after > self.tick;
        let after = if is_whole { 0 } else { after };
        let mut indices = self.moved.after(after);
        indices.extend(self.marked.after(after));
        indices.sort_unstable();
        indices.dedup();
        let of = |index| {
            let mut observed = ObservedBox::removed(index, self.incarnations.of(index));
            observed.user_data = self.copy.states().user_data(index);
            match self.copy.snapshot(index) {
                Some(BoxSnapshot { b, is_on, filter_data, .. }) => {
                    observed.filter_data = filter_data;
                    Some(observed.with_box(b, is_on))
                }
                None => (!is_whole).then_some(observed),
            }
        };
        let boxes = indices.into_iter().filter_map(of).collect();
        let has_filters = is_whole || self.filters_at > after;
        let filters = has_filters.then(|| self.copy.filter_table().clone());
        Observed { tick: self.tick, is_whole, boxes, filters }
    }

    pub const fn user_data(&self) -> UserDataOf<'_> {
        UserDataOf { copy: &self.copy, marked: &self.marked }
    }

    pub const fn reasons(&self) -> Reasons<'_> {
        Reasons { copy: &self.copy, incarnations: &self.incarnations }
    }

    /// The boxes of ranges that are nobody's any more stay.
    pub fn keep(&mut self, ranges: &[Range<u32>]) {
        self.kept.keep(&self.copy, &ranges.iter().cloned().collect());
    }

    /// What is left of some ranges, none of which overlap.
    pub fn remains(&self, ranges: &[Range<u32>]) -> Remains {
        let ranges: Ranges = ranges.iter().cloned().collect();
        Remains::of(&self.copy, &ranges)
    }

    /// Counts a tick that set so many boxes.
    pub fn count_tick(&self, moved: u64, pairs: Option<u64>, times: &StageTimes) {
        let (boxes, engine) = (self.scene.len() as u64, self.scene.engine());
        self.room.counts().note_edit((moved, boxes), pairs, engine, times);
    }

    /// Whether there is room for so many bytes on top.
    pub fn has_room(&self, bytes: u64) -> bool {
        self.room.has(bytes)
    }

    /// Notes what is kept, after a tick of members of whom so much is kept.
    pub fn note_room(&mut self, members_bytes: u64) {
        (self.members_bytes, self.pending) = (members_bytes, Pending::default());
        self.note_bytes();
    }

    fn note_bytes(&mut self) {
        let beside = self.own_bytes() + self.members_bytes + self.pending.bytes;
        self.room.note(&self.scene, beside);
    }
}
