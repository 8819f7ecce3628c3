//! The boxes of a shared scene: where pairs are found, and a copy of what all members have sent.

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::dispatch::CpuEngines;
use pairmask_core::engine::{CullError, EngineChoice};
use pairmask_core::filters::Rules;
use pairmask_core::scene::shared::{Ranges, Remains};
use pairmask_core::scene::{
    Edit, EndReason, FilteredScene, SceneCopy, SceneError, SceneOptions, Told, Want,
};

use super::Tools;
use crate::audit::{AuditedScene, Auditor, SceneNote};
use crate::clients::{PendingBoxes, SceneRoom};
use crate::execute::SceneKeeper;
use crate::publish::Refusal;

/// Bytes of the copy of a box, with its flags.
const BYTES_A_COPY: u64 = 25;

/// All boxes, and what the edits of all members have changed.
pub(super) struct Boxes {
    engine: EngineChoice,
    /// Indices are below this.
    limit: u32,
    tools: Tools,
    scene: FilteredScene<SceneKeeper>,
    /// All boxes: edits are checked against it, and the scene is made again from it where a device is lost.
    /// What the open tick's edits mark in it stays marked until they are applied.
    copy: SceneCopy,
    room: SceneRoom,
    /// Bytes that were kept of members after the last tick.
    members_bytes: u64,
    /// Of the open tick.
    pending: Pending,
    /// Most pairs of all.
    most_pairs: u64,
    /// Whether the scene is to be made again before it is asked.
    is_broken: bool,
    audit: Option<TickAudit>,
}

/// The audit of the scene, while it can be followed, and the edits that it was told.
struct TickAudit {
    scene: AuditedScene,
    edits: u64,
}

/// Why pairs ended, by the boxes and rules of now.
pub(super) struct Reasons<'a> {
    copy: &'a SceneCopy,
    rules: Option<&'a Rules>,
}

impl Reasons<'_> {
    /// Why a pair of boxes that are still there ended.
    pub fn of(&self, [a, b]: [u32; 2]) -> EndReason {
        let kept = [a, b].map(|index| self.copy.kept(index));
        let is_off = !kept.iter().all(|kept| kept.is_some_and(|kept| kept.is_on));
        let are_apart = match self.rules {
            // They know what is static, and may let two static boxes meet.
            Some(rules) => !rules.meet(a, b),
            None => kept.iter().all(|kept| kept.is_some_and(|kept| kept.is_static)),
        };
        if is_off || are_apart { EndReason::Filtered } else { EndReason::Separated }
    }
}

/// What edits of the open tick take that were checked, and wait to be applied.
#[derive(Clone, Copy, Debug, Default)]
struct Pending {
    /// Bytes of the edits, and of rules that they add.
    bytes: u64,
    /// Boxes that they set.
    boxes: PendingBoxes,
}

impl Pending {
    /// Notes an edit that takes so many bytes itself.
    fn add(&mut self, edit: Edit<'_>, bytes: u64) {
        self.bytes += bytes + edit.rule_bytes() as u64;
        self.boxes.count += edit.boxes() as u64;
        self.boxes.index_end = self.boxes.index_end.max(edit.index_end());
    }

    /// Forgets one. The end of its indices stays until the tick ends.
    fn take_off(&mut self, edit: Edit<'_>, bytes: u64) {
        self.bytes = self.bytes.saturating_sub(bytes + edit.rule_bytes() as u64);
        self.boxes.count = self.boxes.count.saturating_sub(edit.boxes() as u64);
    }
}

/// What an edit has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Changed {
    /// What the scene [tells](Boxes::told).
    Told,
    /// Nobody knows.
    Lost,
}

fn new_scene(
    tools: &Tools,
    most_boxes: u32,
    engine: EngineChoice,
) -> Result<FilteredScene<SceneKeeper>, CullError> {
    let options = SceneOptions::default().with_most_boxes(most_boxes);
    let engines = CpuEngines::on(tools.isa, tools.calibration);
    Ok(FilteredScene::over(SceneKeeper::new(options, engines, tools.gpus.for_scene(), engine)?))
}

/// Has an edit, and what the scene told of it, audited.
fn audit_edit(auditor: &Auditor, audit: &mut Option<TickAudit>, edit: Edit<'_>, told: &Told) {
    if let Some(TickAudit { scene, edits }) = audit {
        *edits += 1;
        auditor.follow(scene, || SceneNote::of_tick(*edits, edit, told));
    }
}

impl Boxes {
    /// No boxes, whose indices are below a limit.
    pub fn begin(limit: u32, engine: EngineChoice, tools: Tools) -> Result<Self, Refusal> {
        let audit = tools.auditor.draw_scene(limit);
        Ok(Self {
            audit: audit.map(|scene| TickAudit { scene, edits: 0 }),
            engine,
            limit,
            scene: new_scene(&tools, limit, engine)?,
            copy: SceneCopy::new(limit),
            room: SceneRoom::begin(&tools.memory)?,
            tools,
            members_bytes: 0,
            pending: Pending::default(),
            most_pairs: u64::MAX,
            is_broken: false,
        })
    }

    pub const fn scene(&self) -> &FilteredScene<SceneKeeper> {
        &self.scene
    }

    /// What the last edit has changed, until it is [taken](Self::take).
    pub fn told(&self) -> &Told {
        self.scene.told()
    }

    pub fn take(&mut self) {
        self.scene.take();
    }

    /// Checks an edit of one member. It stays right: nobody else changes its boxes. It is to be applied, or
    /// [cancelled](Self::cancel).
    pub fn check(&mut self, edit: Edit<'_>, bytes: u64) -> Result<(), Refusal> {
        let beside = self.copy.allocated_bytes() as u64 + self.members_bytes + self.pending.bytes;
        let more = bytes + BYTES_A_COPY * edit.index_end();
        self.room.make(&self.scene, edit, self.pending.boxes, beside + more)?;
        self.copy.check(edit)?;
        // Others are checked before it is applied: its boxes are not in the scene then.
        self.pending.add(edit, bytes);
        Ok(())
    }

    /// Forgets an edit that was checked.
    pub fn cancel(&mut self, edit: Edit<'_>, bytes: u64) {
        self.copy.cancel(edit);
        self.pending.take_off(edit, bytes);
    }

    /// Most pairs that later edits may find where they look for all, where an answer has room for so many.
    pub fn limit_pairs(&mut self, of_answer: u64) {
        let most = self.tools.memory.most_pairs(of_answer);
        self.most_pairs = most;
        self.scene.scene_mut().limit_pairs(most);
    }

    /// Applies edits that were checked, by so many threads.
    pub fn apply(&mut self, edit: Edit<'_>, threads: usize) -> Result<Changed, SceneError> {
        let was_made = self.mend(threads);
        let more = self.copy.expand(edit);
        let steps = more.as_ref().map(|more| more.steps(edit));
        let expanded = steps.as_ref().map_or(edit, |steps| Edit { steps });
        let Self { scene, copy, .. } = self;
        if let Err(error) = was_made {
            // The edits are part of what it is made from next.
            copy.apply(expanded);
            return Err(error);
        }
        scene.scene_mut().set_threads(threads);
        let mut search = || scene.edit_expanded(expanded, Want::Changes).map(drop);
        let edited = if threads == 1 {
            let edited = search();
            copy.apply(expanded);
            edited
        } else {
            rayon::join(search, || copy.apply(expanded)).0
        };
        if edited.is_err() {
            // The boxes are in the copy.
            self.note_broken();
            self.mend(threads)?;
            return Ok(Changed::Lost);
        }
        audit_edit(&self.tools.auditor, &mut self.audit, expanded, self.scene.told());
        let is_lost = was_made == Ok(true) || self.scene.told().is_resync();
        Ok(if is_lost { Changed::Lost } else { Changed::Told })
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
        self.scene = new_scene(&self.tools, self.limit, self.engine)?;
        self.scene.scene_mut().set_threads(threads);
        self.scene.scene_mut().limit_pairs(self.most_pairs);
        let whole = self.copy.whole();
        self.scene.edit_expanded(Edit { steps: &whole.steps() }, Want::All)?;
        self.scene.take();
        self.is_broken = false;
        Ok(true)
    }

    /// All pairs of now.
    pub fn whole(&mut self) -> Result<Arc<Vec<[u32; 2]>>, SceneError> {
        match self.scene.edit_expanded(Edit::NONE, Want::All) {
            Ok(told) => {
                let pairs = Arc::new(told.pairs().to_vec());
                audit_edit(&self.tools.auditor, &mut self.audit, Edit::NONE, told);
                self.scene.take();
                Ok(pairs)
            }
            Err(error) => {
                self.note_broken();
                Err(error)
            }
        }
    }

    /// Why pairs ended.
    pub fn reasons(&self) -> Reasons<'_> {
        Reasons { copy: &self.copy, rules: self.scene.rules() }
    }

    /// What is left of some ranges, none of which overlap.
    pub fn remains(&self, ranges: &[Range<u32>]) -> Remains {
        let ranges: Ranges = ranges.iter().cloned().collect();
        Remains::of(&self.copy, &ranges)
    }

    /// Notes what is kept, after a tick of members of whom so much is kept.
    pub fn note_room(&mut self, members_bytes: u64) {
        (self.members_bytes, self.pending) = (members_bytes, Pending::default());
        let beside = self.copy.allocated_bytes() as u64 + members_bytes;
        self.room.note(&self.scene, beside);
    }
}
