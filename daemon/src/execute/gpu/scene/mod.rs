//! Persistent scenes in video memory: edits go up, what changed comes down (GPU.md, "Scenes").
//!
//! A [`GpuScene`] answers as [`Scene`](pairmask_core::scene::Scene) does, byte for byte. This is one file, because an
//! edit, its answer and what is known afterwards change the same few fields.

mod cast;
mod changes;
mod memory;
mod plan;
mod query;
mod replica;
mod roster;
mod search;
mod upload;

use std::sync::{Arc, Mutex, Weak};

use pairmask_core::EngineName;
use pairmask_core::cancel::{Cancel, Wanted};
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::LOST;
use pairmask_core::scene::{
    Edit, Ended, FilterHistory, HistorySnapshot, Report, Reported, SceneError, SceneOptions,
    SceneSkips, SceneSnapshot, Step, decide_changes, is_resync_due,
};
use pairmask_shaders::layouts::{GridLayout, SceneMode, SceneSummary};

use self::cast::Casts;
pub use self::cast::is_for_gpu;
use self::changes::{ChangeSorter, Found};
use self::plan::{Layouts, MOST_SLOTS, Question, Room, Sizes};
use self::replica::{Names, Replica, Replicas, sum};
use self::roster::Roster;
use self::search::{Asked, Search, Share};
use self::upload::Gathered;
use super::{Awake, Block, EngineOptions, Frame, Gpu, GpuError, Pipelines, StepTime, wide};

/// What errors name: scenes on the GPU are a grid there.
const ENGINE: EngineName = EngineName::GpuGrid;

type Pair = [u32; 2];

/// What the scenes of a device share: compiled stages. Edits are copied: which client's memory lies at the address of
/// an import is known of frames alone.
pub struct SceneTools {
    gpu: Arc<Gpu>,
    /// The compiled stages. Compiles those that few daemons need when they are asked for.
    pipelines: Mutex<Pipelines>,
    /// What keeps the clocks up between edits, queries and casts, as between frames.
    awake: Weak<Awake>,
    profiled: bool,
    poison: Option<u32>,
    shares_always: bool,
    binding_bytes: u64,
}

impl SceneTools {
    pub fn new(gpu: &Arc<Gpu>, options: &EngineOptions) -> Result<Arc<Self>, GpuError> {
        Self::kept_awake(gpu, options, Weak::new())
    }

    /// Those of scenes whose submissions keep the clocks up.
    pub fn kept_awake(
        gpu: &Arc<Gpu>,
        options: &EngineOptions,
        awake: Weak<Awake>,
    ) -> Result<Arc<Self>, GpuError> {
        let pipelines = options.pipelines(gpu, search::stages())?;
        Ok(Arc::new(Self {
            gpu: Arc::clone(gpu),
            pipelines: Mutex::new(pipelines),
            awake,
            profiled: options.profiled,
            poison: options.poison,
            shares_always: options.shares_always,
            binding_bytes: gpu.limits().binding_bytes(),
        }))
    }

    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Notes a submission.
    fn note_frame(&self) {
        if let Some(awake) = self.awake.upgrade() {
            awake.note_frame();
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// They are the pairs of now.
    Same,
    /// Records say what has changed since.
    Changed,
    /// Nothing: the next changes are a resync.
    Lost,
}

/// A scene in video memory. One thread uses it at a time; it has the contract of
/// [`Scene`](pairmask_core::scene::Scene), but after [`SceneError::Cull`] the scene is undefined and is to
/// be dropped. Its memory is freed then.
pub struct GpuScene {
    replicas: Replicas,
    options: SceneOptions,
    roster: Roster,
    gathered: Gathered,
    layouts: Layouts,
    /// Of the last searches by their questions: what the next ones are expected to need.
    rooms: [Room; 4],
    was_asked: bool,
    /// The grid of all boxes, where it stands since the last queries.
    standing: Option<GridLayout>,
    /// Whether another was a bad one for queries since the last edit.
    is_second_grid: bool,
    query_pairs: u64,
    most_query_pairs: u64,
    /// The number of the history under way. Records start with 0.
    epoch: u64,
    naming: u32,
    known: Known,
    /// Elements of edits since the history began: as many boxes have changed at most.
    changed: u64,
    count_then: u64,
    reported: Reported,
    is_open: bool,
    sorter: ChangeSorter,
    casts: Casts,
    cancel: Cancel,
    submissions: u32,
    stages: Vec<StepTime>,
}

impl GpuScene {
    pub fn new(tools: &Arc<SceneTools>, options: SceneOptions) -> Self {
        Self::shared(std::slice::from_ref(tools), options)
    }

    /// A scene without boxes that these devices, at least one, keep together, and those that are left
    /// when some are lost. What it reports is what one of them would.
    pub fn shared(tools: &[Arc<SceneTools>], options: SceneOptions) -> Self {
        let most_boxes = options.most_boxes.min(MOST_SLOTS as u32);
        Self {
            replicas: Replicas::new(tools),
            options: options.with_most_boxes(most_boxes),
            roster: Roster::default(),
            gathered: Gathered::default(),
            layouts: Layouts::default(),
            rooms: [Room::default(); 4],
            was_asked: false,
            standing: None,
            is_second_grid: false,
            query_pairs: 0,
            most_query_pairs: u64::from(u32::MAX),
            epoch: 1,
            naming: 0,
            known: Known::Same,
            changed: 0,
            count_then: 0,
            reported: Reported::default(),
            is_open: false,
            sorter: ChangeSorter::default(),
            casts: Casts::default(),
            cancel: Cancel::never(),
            submissions: 0,
            stages: Vec::new(),
        }
    }

    /// Has more devices keep it, if it has no box and none to report of. Those that have it stay.
    pub fn share(&mut self, more: &[Arc<SceneTools>]) {
        if self.is_new() {
            self.replicas.add(more);
        }
    }

    /// Has at most so many devices keep it, and one at the least.
    pub fn keep_on(&mut self, most: usize) {
        // What is on one of them is on each.
        self.replicas.0.truncate(most.max(1));
    }

    /// Whether it has no box, and has none to report of.
    pub fn is_new(&self) -> bool {
        self.roster.states.index_end() == 0
    }

    /// A scene that goes on where another stands: its boxes, flags, filters, and what it reported.
    pub fn from_snapshot(
        tools: &[Arc<SceneTools>],
        options: SceneOptions,
        snapshot: &SceneSnapshot<'_>,
    ) -> Result<Self, SceneError> {
        let mut scene = Self::shared(tools, options);
        let whole = snapshot.whole();
        let steps = whole.steps();
        scene.edit(Edit { steps: &steps }, Report::Nothing)?;
        match snapshot.history() {
            HistorySnapshot::Reported(count) => scene.mark_reported(count),
            // All that there is has changed since there was nothing.
            HistorySnapshot::Unreported => {}
            HistorySnapshot::Lost => scene.resync(),
        }
        Ok(scene)
    }

    /// Boxes, those that are disabled too.
    pub const fn len(&self) -> usize {
        self.roster.states.present()
    }

    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Indices with a box are below this.
    pub fn index_end(&self) -> u32 {
        self.roster.states.index_end() as u32
    }

    pub const fn filters(&self) -> &FilterHistory {
        &self.roster.states.filters
    }

    pub const fn reported(&self) -> &Reported {
        &self.reported
    }

    /// Bytes of host memory that the scene keeps, without what the driver maps.
    pub fn allocated_bytes(&self) -> usize {
        self.roster.allocated_bytes()
            + self.gathered.allocated_bytes()
            + self.sorter.allocated_bytes()
            + self.casts.allocated_bytes()
            + (self.reported.begun().len() + self.reported.pairs().len()) * size_of::<Pair>()
            + size_of_val(self.reported.ended())
    }

    /// Bytes of video memory that the scene keeps on all GPUs, with what the host maps of it, but for copies of edits.
    pub fn video_bytes(&self) -> u64 {
        self.replicas.0.iter().map(Replica::bytes).sum()
    }

    pub const fn gpu_count(&self) -> usize {
        self.replicas.0.len()
    }

    pub fn is_on(&self, gpu: &Gpu) -> bool {
        self.replicas.0.iter().any(|replica| std::ptr::eq(Arc::as_ptr(replica.tools.gpu()), gpu))
    }

    /// Threads of the pool for later edits and queries; `None` is all. With one, none is touched.
    pub const fn set_threads(&mut self, threads: Option<usize>) {
        self.options.threads = threads;
    }

    /// As [`Scene::set_asker`](pairmask_core::scene::Scene::set_asker). Between two submissions it is looked whether an
    /// answer is still wanted.
    pub fn set_asker(&mut self, asker: Option<Arc<dyn Wanted>>) {
        self.cancel = Cancel::by(asker);
    }

    /// # Errors
    /// [`CullError::Cancelled`].
    fn check_wanted(&self) -> Result<(), CullError> {
        if self.cancel.look() { Err(CullError::Cancelled) } else { Ok(()) }
    }

    pub const fn submissions(&self) -> u32 {
        self.submissions
    }

    pub fn stages(&self) -> &[StepTime] {
        &self.stages
    }

    /// Applies an edit and answers. The answer counts as reported when it is [acknowledged](Self::acknowledge); else the
    /// next one makes up for it.
    ///
    /// # Errors
    /// [`SceneError::Edit`] for an edit that is wrong: nothing is applied, and the last answer stays.
    /// [`SceneError::Cull`] where the device is lost, or has no memory, or the scene is too crowded for
    /// it: the scene is to be dropped.
    pub fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<&Reported, SceneError> {
        self.roster.check(edit, self.options.most_boxes)?;
        self.submissions = 0;
        self.is_open = false;
        self.roster.apply(edit);
        self.note_edit_for_casts(edit);
        if let Err(error) = self.answer(edit, report) {
            self.known = Known::Lost;
            return Err(SceneError::Cull(error));
        }
        self.is_open = true;
        Ok(&self.reported)
    }

    /// Takes the last answer: what it reported is what the next changes are counted from. Without effect
    /// on an answer that was taken, and on [`Report::Moved`] and [`Report::Nothing`].
    pub fn acknowledge(&mut self) {
        if !std::mem::take(&mut self.is_open)
            || !matches!(self.reported.report(), Report::Changes | Report::All)
        {
            return;
        }
        self.mark_reported(self.reported.pair_count().unwrap_or(0));
    }

    /// Marks the pairs of now as reported, of which there are so many.
    pub fn mark_reported(&mut self, pair_count: u64) {
        self.is_open = false;
        self.count_then = pair_count;
        self.begin_history();
    }

    /// Drops what was reported: the next changes are a resync. A client that has lost its pairs asks so.
    pub fn resync(&mut self) {
        self.begin_history();
        self.known = Known::Lost;
        self.is_open = false;
        self.reported = Reported::of_none(Report::Nothing, 0);
    }

    fn begin_history(&mut self) {
        if self.known == Known::Changed || self.changed > 0 {
            self.epoch += 1;
        }
        self.known = Known::Same;
        self.changed = 0;
        self.roster.discard();
    }

    fn answer(&mut self, edit: Edit<'_>, report: Report) -> Result<(), CullError> {
        let sets: u64 = edit.sets().map(|sets| sets.boxes.len() as u64).sum();
        let elements = sets + self.roster.marks.len() as u64;
        self.changed += elements;
        if elements > 0 && self.known == Known::Same {
            self.known = Known::Changed;
        }
        let is_named = |step: &Step<'_>| !matches!(step, Step::Remove(_));
        let names = elements > 0 && edit.steps.iter().any(is_named);
        let mode = match report {
            Report::Changes if self.known == Known::Lost => Some(SceneMode::All),
            Report::Changes => (self.known == Known::Changed).then_some(SceneMode::Changes),
            Report::Moved => names.then_some(SceneMode::Moved),
            Report::All => Some(SceneMode::All),
            _ => None,
        };
        // A scene without records has no pairs.
        let mode = mode.filter(|_| self.roster.states.index_end() > 0);
        if elements == 0 && mode.is_none() {
            let pair_count = if report == Report::Changes { self.count_then } else { 0 };
            let is_resync = report == Report::Changes && self.known == Known::Lost;
            self.reported = if is_resync {
                Reported::of_pairs(report, Arc::default(), 0)
            } else {
                Reported::of_none(report, pair_count)
            };
            self.reported_skips(None);
            return Ok(());
        }
        // Boxes are elsewhere, or the blocks of the grid are another search's.
        (self.was_asked, self.standing, self.is_second_grid) = (false, None, false);
        self.put_edit(edit, mode)?;
        let answered = self.search(elements, report, mode);
        self.replicas.end_edit();
        let summary = answered?;
        self.reported_skips(summary.as_ref());
        Ok(())
    }

    fn put_edit(&mut self, edit: Edit<'_>, mode: Option<SceneMode>) -> Result<(), CullError> {
        let slots = self.roster.states.index_end();
        let mut names = Names::Kept;
        if mode == Some(SceneMode::Moved) {
            self.naming = self.naming.wrapping_add(1);
            names = Names::Given;
            if self.naming == 0 {
                names = Names::Discarded;
                self.naming = 1;
            }
        }
        let threads = self.threads();
        let (sets, marks) = (self.gathered.sets(edit), &self.roster.marks);
        self.replicas
            .on_each(|_, replica| replica.put(sets, marks, &[], slots as u64, names, threads))?;
        if let Some(most) = edit.sets().max_by_key(|sets| sets.boxes.len()) {
            self.layouts.note_edit(most.boxes, slots);
        }
        Ok(())
    }

    /// Applies an edit and searches until there is an answer; what the last search said.
    fn search(
        &mut self,
        elements: u64,
        report: Report,
        mode: Option<SceneMode>,
    ) -> Result<Option<SceneSummary>, CullError> {
        let mut question = Question {
            mode: mode.unwrap_or_default(),
            slots: self.roster.states.index_end() as u64,
            active: self.roster.states.active() as u64,
            changed: if mode == Some(SceneMode::Moved) { elements } else { self.changed },
        };
        question.changed = question.changed.min(question.slots);
        let mut least = Room::default();
        let mut applies = true;
        loop {
            let expected = Room::expected(&question, self.rooms[question.mode as usize])
                .within(self.replicas.first().tools.binding_bytes);
            let room = Room {
                entries: expected.entries.max(least.entries),
                pairs: expected.pairs.max(least.pairs),
            };
            let layout = self.layouts.layout(&question);
            let sizes = Sizes::of(&question, &layout, 0);
            let (epoch, naming) = (self.epoch, self.naming);
            let gpus = self.replicas.0.len();
            let shares = if mode.is_none() {
                0
            } else if self.replicas.first().tools.shares_always {
                gpus
            } else {
                question.shares(gpus)
            };
            let asked = |at: usize| {
                let share = Share { index: at as u32, count: shares as u32 };
                let search = if at < shares { Search::Pairs(share) } else { Search::Nothing };
                Asked { question, search, layout, sizes, room, epoch, naming, applies }
            };
            self.check_wanted()?;
            let rooms = self.replicas.on_each(|at, replica| replica.submit(&asked(at)))?;
            let summaries = self.replicas.on_each(|at, replica| replica.wait(&asked(at)))?;
            applies = false;
            self.submissions += 1;
            if summaries.len() < gpus {
                // Who has failed had a share: those that are left search for all of it.
                continue;
            }
            self.note_stages()?;
            if mode.is_none() {
                self.reported = Reported::of_none(report, 0);
                return Ok(None);
            }
            let (rooms, summaries) = (&rooms[..shares], &summaries[..shares]);
            let summary = sum(summaries);
            let (found, ended) = (wide(summary.found), wide(summary.ended));
            let entries = u64::from(summary.entries);
            if rooms.iter().any(|made| entries > made.entries) {
                least.entries = entries;
                continue;
            }
            if summaries.iter().any(|share| share.tested[1] >= search::BUDGET) {
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            let is_filtered = self.filters().is_used();
            if question.mode == SceneMode::Changes && !is_filtered {
                let pair_count = (self.count_then + (found - ended)).saturating_sub(ended);
                if is_resync_due(found, pair_count) {
                    question.mode = SceneMode::All;
                    continue;
                }
            }
            let counts: Vec<u64> = summaries.iter().map(|share| wide(share.found)).collect();
            let most = counts.iter().copied().max().unwrap_or(0);
            if rooms.iter().zip(&counts).any(|(made, count)| *count > made.pairs) {
                least.pairs = most;
                let needed_bytes = most.saturating_mul(size_of::<Pair>() as u64);
                if needed_bytes > self.replicas.first().tools.binding_bytes {
                    return Err(ReserveError::OutOfMemory { needed_bytes }.into());
                }
                continue;
            }
            let looked = entries + u64::from(summary.rows);
            self.layouts.note_search(&question, &summary, looked, wide(summary.tested));
            self.rooms[question.mode as usize] = Room { entries, pairs: most };
            self.report(report, question.mode, ended, &counts)?;
            if is_filtered && self.filter_reported() {
                question.mode = SceneMode::All;
                continue;
            }
            return Ok(Some(summary));
        }
    }

    fn note_stages(&mut self) -> Result<(), CullError> {
        let first = self.replicas.first();
        if first.tools.profiled {
            let times = first.frames.last().map_or(Ok(Vec::new()), Frame::step_times);
            self.stages = times.map_err(|error| first.tools.gpu.cull_error(ENGINE, &error))?;
        }
        Ok(())
    }

    /// Reads what was found, so many pairs by each GPU, sorts it, and reports it.
    fn report(
        &mut self,
        report: Report,
        mode: SceneMode,
        ended: u64,
        counts: &[u64],
    ) -> Result<(), CullError> {
        let found: u64 = counts.iter().sum();
        let needed_bytes = found * size_of::<Pair>() as u64;
        let no_memory = |_| CullError::Reserve(ReserveError::OutOfMemory { needed_bytes });
        let blocks = self.replicas.0.iter().filter_map(|replica| replica.blocks.as_ref());
        let lists: Vec<(&Block, usize)> =
            blocks.zip(counts).map(|(b, count)| (&*b.found.block, *count as usize)).collect();
        let read = |at: usize, to: &mut [Pair]| read_lists(&lists, at, to);
        let (count, n, threads) =
            (found as usize, self.roster.states.index_end() as u32, self.threads());
        let list = Found { read: &read, count, n, threads };
        if mode != SceneMode::Changes {
            let mut pairs = Vec::new();
            pairs.try_reserve(found as usize).map_err(no_memory)?;
            self.sorter.pairs(&list, &mut pairs);
            self.reported = Reported::of_pairs(report, Arc::new(pairs), found);
            return Ok(());
        }
        let (mut begun, mut ends) = std::mem::take(&mut self.reported).into_changes();
        let more = |len: usize, requested: u64| (requested as usize).saturating_sub(len);
        begun.try_reserve(more(begun.len(), found - ended)).map_err(no_memory)?;
        ends.try_reserve(more(ends.len(), ended)).map_err(no_memory)?;
        self.sorter.changes(&list, &mut begun, &mut ends);
        let pair_count = (self.count_then + begun.len() as u64).saturating_sub(ends.len() as u64);
        self.reported = Reported::of_changes(begun, ends, pair_count);
        Ok(())
    }

    /// Takes what the filters keep apart out of the answer. Whether it is to be a resync instead.
    fn filter_reported(&mut self) -> bool {
        let reported = std::mem::take(&mut self.reported);
        let (report, states) = (reported.report(), &self.roster.states);
        if report != Report::Changes || reported.is_resync() {
            let mut pairs = reported.pairs().to_vec();
            pairs.retain(|pair| states.filters.meet(*pair));
            let pair_count = if report == Report::Moved { 0 } else { pairs.len() as u64 };
            self.reported = Reported::of_pairs(report, Arc::new(pairs), pair_count);
            return false;
        }
        let (mut begun, mut ended) = reported.into_changes();
        let is_replaced = |pair| states.has_either(pair, LOST);
        decide_changes(&states.filters, is_replaced, &mut begun, &mut ended);
        for Ended { pair, reason } in &mut ended {
            *reason = states.end_reason(*pair);
        }
        let pair_count = (self.count_then + begun.len() as u64).saturating_sub(ended.len() as u64);
        let is_resync = is_resync_due((begun.len() + ended.len()) as u64, pair_count);
        self.reported = Reported::of_changes(begun, ended, pair_count);
        is_resync
    }

    fn reported_skips(&mut self, summary: Option<&SceneSummary>) {
        let (active, statics) =
            (self.roster.states.active() as u64, self.roster.states.active_still() as u64);
        let (moved, moved_statics, tested) = match summary {
            Some(s) if self.known == Known::Changed && self.reported.pairs().is_empty() => {
                (u64::from(s.moved), u64::from(s.moved_static), wide(s.tested))
            }
            Some(s) => (active, statics, wide(s.tested)),
            None => (0, 0, 0),
        };
        let (moved, moved_statics) = (moved.min(active), moved_statics.min(statics));
        let skips = SceneSkips::of([active, statics], [moved, moved_statics], tested);
        self.reported = std::mem::take(&mut self.reported).with_skips(skips);
    }

    fn threads(&self) -> usize {
        match self.options.threads {
            Some(0 | 1) => 1,
            threads => {
                let pool = rayon::current_num_threads();
                threads.map_or(pool, |threads| threads.clamp(1, pool))
            }
        }
    }
}

/// Reads pairs of lists that follow each other, from a place of all of them on.
fn read_lists(lists: &[(&Block, usize)], at: usize, to: &mut [Pair]) {
    let (mut skipped, mut rest) = (at, to);
    for (block, count) in lists {
        let here = count.saturating_sub(skipped).min(rest.len());
        if here > 0 {
            let (these, later) = rest.split_at_mut(here);
            block.read((skipped * size_of::<Pair>()) as u64, these);
            rest = later;
        }
        skipped = skipped.saturating_sub(*count);
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::Aabb;
    use pairmask_core::scene::{Scene, Sets};

    use super::*;
    use crate::execute::gpu::{GpuChoice, HostImport};

    /// Two boxes that touch, apart, and together again.
    fn check_rounds(mut gpu: GpuScene, report: Report) {
        let mut core = Scene::new(SceneOptions::default());
        for round in 0..6u32 {
            let x = if round % 2 == 0 { 1.0 } else { 1.5 };
            let boxes = [0.0, x].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
            // Later rounds name one box only.
            let named = if round < 2 { 0..2 } else { 1..2 };
            let boxes = &boxes[named.start as usize..];
            let steps = [Step::Set(Sets { indices: named.into(), boxes })];
            core.edit(Edit { steps: &steps }, report).expect("an answer");
            gpu.edit(Edit { steps: &steps }, report).expect("an answer");
            assert_eq!(gpu.reported().begun(), core.reported().begun(), "{round}");
            assert_eq!(gpu.reported().ended(), core.reported().ended(), "{round}");
            assert_eq!(gpu.reported().pairs(), core.reported().pairs(), "{round}");
            core.acknowledge();
            gpu.acknowledge();
        }
    }

    #[test]
    fn histories_and_namings_are_numbered_beyond_32_bits() {
        let gpu = Gpu::open(&GpuChoice::Software, HostImport::Never);
        let gpu = gpu.unwrap_or_else(|error| panic!("the GPU tests need an adapter: {error}"));
        let tools = SceneTools::new(&gpu, &EngineOptions::default()).expect("stages");
        let mut scene = GpuScene::new(&tools, SceneOptions::default());
        scene.epoch = (1 << 32) - 3;
        check_rounds(scene, Report::Changes);
        let mut scene = GpuScene::new(&tools, SceneOptions::default());
        // So that there is memory for names whose numbers come again.
        scene.edit(Edit::NONE, Report::Moved).expect("an answer");
        scene.naming = u32::MAX - 2;
        check_rounds(scene, Report::Moved);
    }
}
