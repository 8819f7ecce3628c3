//! Persistent scenes: boxes stay from answer to answer, edits go in, changes of pairs come out.
//!
//! A client gives each box an index of its own, says by an [`Edit`] what changes, and [asks](Report) to
//! know which pairs began and ended, which there are around the boxes that moved, or all. A small edit
//! costs what it changes, not what the scene holds. One file, because an edit, its answer and what is known afterwards
//! change the same few fields; what they do stands in the modules below.
//!
//! # What is reported
//!
//! * Pairs are those of boxes that overlap by the rules of [`aabb`](crate::aabb), that are enabled,
//!   and that their [collision filters](crate::filters) let meet: two static boxes are no pair.
//! * [`Report::Changes`] reports what differs from the pairs of the last answer that was **acknowledged**
//!   ([`Scene::acknowledge`]): each change exactly once, however many answers were dropped between. What began
//!   and ended again in between is not reported. [`Report::All`], acknowledged, counts as reported too. [`Report::Moved`]
//!   reports no end, so acknowledging it changes nothing: the next changes hold its news as well.
//! * A pair is named by its indices and their incarnations. So a pair of an index whose box was removed
//!   meanwhile is reported as ended, and as begun where the index has a new box that overlaps too. Flags, filter data
//!   and entries in pair lists are those of the box, and end with it.
//! * History never shows: an answer depends on the states of the boxes at the last acknowledged answer, those of
//!   now, and which were removed between. All lists are sorted, so that the bytes do not depend on
//!   threads, nor on how the pairs were found.
//!
//! [`Scene::query`] asks which boxes some other boxes overlap, [`Scene::cast`] which ones rays hit or are nearest to
//! points; both change nothing that is reported.
//!
//! # How
//!
//! A change is what differs between then and now around the boxes whose state has changed (`store`), and one function
//! says so (`change`), with the filters of then and now (`rules`). After few changes, boxes lie in cells (`cells`), and
//! only what lies around changed boxes is looked at (`history`): no pairs are stored. Where cells do not part the boxes,
//! the tree of casts takes their place for a while. Where more boxes have changed than that pays for, at the most one in
//! three, one cull finds all pairs of now (`whole`), and those that the last one found are compared with them. All give
//! the same lists. Pairs of moved boxes are what queries by these find (`query`).
//!
//! The ways differ in what they keep. The second small edit after a large one builds the cells, which takes about as long
//! as one to four whole frames; the first one is answered as the large one was, and a single large one among small ones
//! leaves the cells as they are. Cells are also built anew when their layout has become unfit: after 16 moves a box, where
//! searches test half as many boxes again as they began with, or where the blocks of cells have grown by a half.

mod answer;
mod cells;
mod change;
mod copy;
mod draft;
mod edit;
mod error;
mod history;
mod indices;
mod margins;
mod options;
mod pair_list;
mod query;
mod replica;
mod rules;
pub mod shared;
mod snapshot;
mod snapshots;
pub mod states;
mod store;
mod whole;
mod worth;

pub use self::answer::{EndReason, Ended, Report, Reported, SceneSkips, is_resync_due};
pub use self::copy::{SceneCopy, WholeScene};
pub use self::draft::{Draft, Given};
pub use self::edit::{Edit, FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};
pub use self::error::{EditError, SceneError};
pub use self::margins::{ExactPairs, MarginStats, Margined, MarginedSets, Margins, Outgoing};
pub use self::options::SceneOptions;
pub use self::pair_list::{Sorter as PairSorter, sort_row};
pub use self::query::{
    BeyondMask, Cast, CastTree, QueryError, QueryFilterData, QueryMask, between, cull_between,
    is_small_set, more_pairs_than,
};
pub use self::replica::Replica;
pub use self::rules::{FilterHistory, FilteredBoxes, apply_rules, decide_changes};
pub use self::snapshot::{BoxSnapshot, HistorySnapshot, SceneSnapshot};
pub use self::snapshots::{
    AfterPhase, Replicas, RestorePhase, SnapshotId, Snapshots, UnknownSnapshot,
};

use std::sync::Arc;

use self::cells::Cells;
use self::history::Changes;
use self::pair_list::{Difference, Pair, pair};
use self::query::Asked;
use self::states::{LOST, NAMED, STILL};
use self::store::Store;
use self::whole::Whole;
use self::worth::{Account, Worth, is_near};
use crate::aabb::Aabb;
use crate::backoff::Backoff;
use crate::cancel::{Cancel, Wanted};
use crate::dispatch::CpuEngines;
use crate::engine::CullError;
use crate::team;

/// Changed boxes by which it is judged how many have gone far.
const JUDGED: usize = 64;
/// Boxes up to which cells are built at the first small edit: some 100 µs. In a larger scene that edit may
/// stand between large ones, which keep no cells: it is answered as they are, and the next one builds cells.
const CELLS_AT_ONCE: usize = 4_096;

/// A changed box that is looked around takes so long on one thread, ns: 1,000 of 100,000 take .42 ms, 10,000 of a
/// million 3.6 to 4.1.
const CHANGED_NS: f64 = 400.0;
/// Share of that which further threads do not shorten: boxes go from cell to cell on one. Passes over regions of cells
/// side by side took longer on any number of threads up to 16.
const CHANGED_SERIAL_SHARE: f64 = 0.2;
/// A changed box that is looked around in a tree takes so long on one thread, ns.
const CROWDED_NS: f64 = 4_000.0;
/// A box of a scene that is culled as a whole: two to three times what a frame takes.
const WHOLE_NS: f64 = 150.0;

/// What a scene knows of the pairs that were reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    /// They are the pairs of now.
    Same,
    /// Those of the few boxes that have changed since, which are looked around.
    Few,
    /// The boxes that have changed, as they were. There are no cells.
    Many,
    /// Nothing: the next changes are a resync.
    Lost,
}

/// Boxes that stay from edit to edit, and what was reported of their pairs.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::{Edit, EndReason, Scene, SceneOptions, Sets, Step, Report};
///
/// let boxes = [[0.0, 1.0], [0.5, 2.0], [1.5, 3.0]].map(|[a, b]| Aabb::new([a; 3], [b; 3]));
/// let mut scene = Scene::new(SceneOptions::default());
/// let all = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
/// let reported = scene.edit(Edit { steps: &all }, Report::Changes)?;
/// assert_eq!(reported.begun(), [[0, 1], [1, 2]]);
/// scene.acknowledge();
///
/// let off = [Step::Enable((&[2]).into(), false)];
/// let reported = scene.edit(Edit { steps: &off }, Report::Changes)?;
/// assert!(reported.begun().is_empty());
/// assert_eq!(reported.ended()[0].pair, [1, 2]);
/// assert_eq!(reported.ended()[0].reason, EndReason::Filtered);
/// # Ok::<(), pairmask_core::scene::SceneError>(())
/// ```
pub struct Scene {
    options: SceneOptions,
    store: Store,
    cells: Option<Cells>,
    /// Whether the last edit changed few boxes.
    was_small: bool,
    /// How long edits do without cells, which did not part the boxes: with a tree instead.
    crowded: Backoff,
    /// What looking around changed boxes took.
    worth: Worth,
    changes: Changes,
    known: Known,
    /// All pairs of now, where there is a list of them.
    list_now: Option<Arc<Vec<Pair>>>,
    /// All pairs that were reported, where there is a list of them.
    list_then: Option<Arc<Vec<Pair>>>,
    /// How many were reported.
    count_then: u64,
    reported: Reported,
    /// Whether the last answer can be taken.
    is_open: bool,
    whole: Whole,
    /// Memory of a list that is no longer needed.
    spare: Vec<Pair>,
    /// Comparisons of the edit under way.
    tested: u64,
    /// Threads of the edit or query under way.
    threads: usize,
    /// What queries need.
    asked: Asked,
    /// Whether the edit or query under way is to end.
    cancel: Cancel,
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let known = &self.known;
        f.debug_struct("Scene")
            .field("boxes", &self.len())
            .field("known", known)
            .finish_non_exhaustive()
    }
}

impl Scene {
    /// A scene without boxes.
    pub fn new(options: SceneOptions) -> Self {
        Self::with_engines(options, CpuEngines::new())
    }

    /// A scene without boxes that is searched as a whole by given engines.
    pub fn with_engines(options: SceneOptions, engines: CpuEngines) -> Self {
        Self {
            options: options.within_limits(),
            store: Store::default(),
            cells: None,
            was_small: false,
            crowded: Backoff::NONE,
            worth: Worth::UNKNOWN,
            changes: Changes::default(),
            known: Known::Same,
            list_now: None,
            list_then: None,
            count_then: 0,
            reported: Reported::default(),
            is_open: false,
            whole: Whole::new(engines),
            spare: Vec::new(),
            tested: 0,
            threads: 1,
            asked: Asked::default(),
            cancel: Cancel::never(),
        }
    }

    /// Boxes, those that are disabled too.
    pub const fn len(&self) -> usize {
        self.store.states.present()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Indices of boxes are below this.
    pub fn index_end(&self) -> u32 {
        self.store.boxes().len() as u32
    }

    /// The box of an index, also one that is disabled.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        self.store.get(index)
    }

    /// Collision filters, and what they were when the history began.
    pub const fn filters(&self) -> &FilterHistory {
        &self.store.states.filters
    }

    /// Threads for later edits, of the rayon pool that they are made in; `None` is all of them.
    pub const fn set_threads(&mut self, threads: Option<usize>) {
        self.options.threads = threads;
    }

    /// Most pairs that the scene may have where all of them have to be found, before or after an edit; 2^32 − 1 unless
    /// set. [`SceneError::Cull`] where there are more.
    pub fn limit_pairs(&mut self, most: u64) {
        self.whole.limit_pairs(most);
    }

    /// Who says whether the answers of later edits, queries and casts are still wanted; `None` where they are in any case.
    /// Is kept until another one, or none, is set.
    pub fn set_asker(&mut self, asker: Option<Arc<dyn Wanted>>) {
        self.cancel = Cancel::by(asker);
    }

    /// All of it, as an edit that makes it where there is no box.
    pub fn whole(&self) -> WholeScene<'_> {
        self.store.whole()
    }

    /// What the scene holds, for who keeps it from now on; `None` where it has changed since the last taken
    /// answer, and pairs were reported in that or may be taken still.
    pub fn snapshot(&self) -> Option<SceneSnapshot<'_>> {
        let is_untaken =
            self.is_open && matches!(self.reported.report, Report::Changes | Report::All);
        let history = match self.known {
            Known::Same => HistorySnapshot::Reported(self.count_then),
            _ if is_untaken => return None,
            Known::Lost => HistorySnapshot::Lost,
            Known::Few | Known::Many if self.count_then == 0 => HistorySnapshot::Unreported,
            Known::Few | Known::Many => return None,
        };
        Some(SceneSnapshot::new(&self.store, history))
    }

    /// The last answer.
    pub const fn reported(&self) -> &Reported {
        &self.reported
    }

    /// Bytes that the scene keeps, but for engines' tasks and what is below a KiB.
    pub fn allocated_bytes(&self) -> usize {
        let list = |list: &Option<Arc<Vec<Pair>>>| {
            list.as_ref().map_or(0, |list| list.capacity() * size_of::<Pair>())
        };
        self.store.allocated_bytes()
            + self.cells.as_ref().map_or(0, Cells::allocated_bytes)
            + self.asked.allocated_bytes()
            + self.changes.allocated_bytes()
            + list(&self.list_now)
            + self.reported.allocated_bytes()
            + self.spare.capacity() * size_of::<Pair>()
            + self.whole.allocated_bytes()
    }

    /// Applies an edit and answers. The answer counts as reported when it is [acknowledged](Self::acknowledge); else the
    /// next one makes up for it.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmask_core::filters::{Owner, FilterData};
    /// use pairmask_core::scene::{Edit, EndReason, Scene, SceneOptions, Sets, Step, FilterDataSets, Report};
    ///
    /// let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 3];
    /// let mut scene = Scene::new(SceneOptions::default());
    /// let all = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
    /// assert_eq!(scene.edit(Edit { steps: &all }, Report::Changes)?.begun().len(), 3);
    /// scene.acknowledge();
    ///
    /// // Two of them are parts of one body.
    /// let filter_data = [FilterData::default().with_owner(Owner(7)); 2];
    /// let body = [Step::FilterData(FilterDataSets { indices: (&[0, 2]).into(), filter_data: &filter_data })];
    /// let reported = scene.edit(Edit { steps: &body }, Report::Changes)?;
    /// assert!(reported.begun().is_empty());
    /// assert_eq!(reported.ended()[0].pair, [0, 2]);
    /// assert_eq!(reported.ended()[0].reason, EndReason::Filtered);
    /// # Ok::<(), pairmask_core::scene::SceneError>(())
    /// ```
    ///
    /// # Errors
    /// [`SceneError::Edit`] for an edit that is wrong: nothing is applied, and the last answer stays.
    /// [`SceneError::Cull`] where all pairs are needed and cannot be found: the edit is applied. After
    /// [`CullError::Cancelled`] the scene is to be dropped.
    pub fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<&Reported, SceneError> {
        self.threads = edit_threads(self, edit, report);
        let _team = team::enter(self.threads);
        self.store.apply(edit, self.options.most_boxes, self.threads)?;
        self.is_open = false;
        self.tested = 0;
        self.reported.begin(report);
        self.note_changes();
        if let Err(error) = self.answer(report) {
            self.resync();
            return Err(error.into());
        }
        self.is_open = true;
        Ok(&self.reported)
    }

    /// Takes the last answer: what it reported is what the next changes are counted from. Without effect
    /// on an answer that was taken, and on [`Report::Moved`] and [`Report::Nothing`].
    pub fn acknowledge(&mut self) {
        if !std::mem::take(&mut self.is_open)
            || !matches!(self.reported.report, Report::Changes | Report::All)
        {
            return;
        }
        self.mark_reported(self.reported.pair_count);
    }

    /// Marks the pairs of now as reported, of which there are so many: by a client that goes back to a snapshot, and
    /// knows them.
    pub fn mark_reported(&mut self, pair_count: u64) {
        self.is_open = false;
        self.count_then = pair_count;
        if !self.is_settled() || self.list_now.is_some() {
            let then = std::mem::replace(&mut self.list_then, self.list_now.clone());
            self.recycle(then);
        }
        self.known = Known::Same;
        if let Some(cells) = &mut self.cells {
            cells.discard(self.store.changed());
        }
        self.store.discard();
    }

    /// Drops what was reported: the next changes are a resync. A client that has lost its pairs asks so.
    pub fn resync(&mut self) {
        self.known = Known::Lost;
        self.is_open = false;
        self.cells = None;
        self.store.discard();
        for list in [self.list_now.take(), self.list_then.take()] {
            self.recycle(list);
        }
        self.reported.begin(Report::Nothing);
    }

    /// Keeps the memory of a list, unless the last answer still shows it.
    fn recycle(&mut self, list: Option<Arc<Vec<Pair>>>) {
        if let Some(Ok(list)) = list.map(Arc::try_unwrap)
            && list.capacity() > self.spare.capacity()
        {
            self.spare = list;
        }
    }

    /// Whether nothing has changed since the last taken answer.
    fn is_settled(&self) -> bool {
        self.known == Known::Same
    }

    /// Threads of the last edit or query.
    pub const fn threads(&self) -> usize {
        self.threads
    }

    /// Indices are below this.
    pub const fn most_boxes(&self) -> u32 {
        self.options.most_boxes
    }

    /// What is known of the scene since its history began.
    fn account(&self) -> Account {
        let changed = self.store.changed();
        let judged = changed.iter().step_by(changed.len().div_ceil(JUDGED).max(1));
        let is_near = |index: &&u32| {
            let was = self.store.before(**index);
            was.is_none_or(|was| is_near(&was.b, &self.store.boxes()[**index as usize]))
        };
        let of = judged.len() as u64;
        Account {
            boxes: self.len() as u64,
            pairs: self.count_then,
            compared: self.whole.compared(),
            far: of - judged.filter(is_near).count() as u64,
            of,
            threads: team::threads_for(self.len() as f64 * WHOLE_NS, self.options.threads),
        }
    }

    /// As many changed boxes take as long to be looked around as the whole scene does.
    fn many(&self) -> usize {
        self.worth.many(self.account(), self.crowded.will_wait())
    }

    /// Notes what the last edit has changed.
    fn note_changes(&mut self) {
        let store = &self.store;
        if !store.is_changed() {
            return;
        }
        let now = self.list_now.take();
        self.recycle(now);
        self.note_for_queries();
        if matches!(self.known, Known::Many | Known::Lost) {
            return;
        }
        let (changed, present, many) = (self.store.changed().len(), self.len(), self.many());
        self.known = Known::Many;
        let was_small = std::mem::replace(&mut self.was_small, changed <= many);
        // One large edit among small ones is no reason to build cells anew, which takes as long as several.
        let is_alone = was_small && self.cells.is_some() && changed <= 2 * many;
        if changed > many && !is_alone {
            self.drop_cells();
            self.worth.forget_tests();
            return;
        }
        if self.cells.is_none() && !was_small && present > CELLS_AT_ONCE {
            return;
        }
        if self.cells.is_none() && self.crowded.is_waiting() {
            if self.worth.does_tree_pay(changed, self.account()) {
                self.known = Known::Few;
            } else {
                self.worth.forget_looks();
            }
            return;
        }
        self.known = Known::Few;
        let (threads, store) = (self.threads, &self.store);
        if let Some(cells) = &mut self.cells {
            cells.update(store, [store.ended(), store.named()], threads);
            return;
        }
        // Those of the scene as it was when its history began, brought to what it is.
        let (boxes, statics) = store.then();
        let mut cells = Cells::of(&boxes, |index| statics[index as usize], threads);
        cells.update(store, [store.changed(), &[]], threads);
        self.cells = Some(cells);
        self.asked.drop_cells();
        self.drop_lists();
    }

    /// Drops the cells of edits, which serve queries too: those are to pay for others anew.
    fn drop_cells(&mut self) {
        if self.cells.take().is_some() {
            self.asked.spend_all();
        }
    }

    /// Gives back what only whole scenes need, which are asked for seldom from now on.
    fn drop_lists(&mut self) {
        self.whole.give_back();
        (self.list_then, self.spare) = (None, Vec::new());
    }

    fn answer(&mut self, report: Report) -> Result<(), CullError> {
        match report {
            Report::Nothing => {}
            Report::Moved => self.report_moved()?,
            Report::All => self.report_all()?,
            Report::Changes => match self.known {
                Known::Lost => self.report_resync()?,
                Known::Same => self.reported.pair_count = self.count_then,
                Known::Few => self.report_changes_around()?,
                Known::Many => self.report_changes_of_whole()?,
            },
        }
        self.reported.skipped = self.skips();
        Ok(())
    }

    /// Looks around the boxes that have changed: in cells, in a tree for a while where these do not part the boxes, and
    /// in the whole scene where that does not either.
    fn report_changes_around(&mut self) -> Result<(), CullError> {
        let found = match self.changes_in_cells()? {
            None => self.changes_in_tree()?,
            found => found,
        };
        let Some((found, tested)) = found else {
            self.known = Known::Many;
            return self.report_changes_of_whole();
        };
        self.tested += tested;
        self.report(found, false)
    }

    /// What changed, and the boxes that were tested; `None` where there are no cells, or they do not part the boxes.
    fn changes_in_cells(&mut self) -> Result<Option<(Difference, u64)>, CullError> {
        let Some(cells) = &mut self.cells else { return Ok(None) };
        let (store, threads) = (&self.store, self.threads);
        let most = (2 * self.whole.most_pairs(), &self.cancel);
        let found = self.changes.find(cells, store, threads, most);
        if self.cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        if let Some((_, tested)) = found {
            let searches = store.changed().len();
            cells.note_searches(searches as u64, tested);
            self.worth.note_tests(searches, tested);
            self.crowded = Backoff::NONE;
        } else {
            self.drop_cells();
            self.crowded.failed();
        }
        Ok(found)
    }

    /// The same by a tree.
    fn changes_in_tree(&mut self) -> Result<Option<(Difference, u64)>, CullError> {
        let (searches, account) = (self.store.changed().len(), self.account());
        if !self.worth.does_tree_pay(searches, account) {
            return Ok(None);
        }
        let (store, threads, looks) = (&self.store, self.threads, account.most_looks());
        let most = (2 * self.whole.most_pairs(), &self.cancel);
        let tree = self.asked.tree(store, threads, &self.cancel);
        let found = tree.and_then(|tree| history::crowded::find(tree, store, threads, looks, most));
        if self.cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        // Where it did not, it would have looked at more.
        let looked_at = found.as_ref().map_or(2 * looks, |(_, looked_at)| *looked_at);
        self.worth.note_looks(searches, looked_at);
        if found.is_some() && self.list_then.is_some() {
            self.drop_lists();
        }
        Ok(found)
    }

    fn report_changes_of_whole(&mut self) -> Result<(), CullError> {
        let then = if let Some(then) = &self.list_then {
            Arc::clone(then)
        } else {
            let (mut list, threads) = (std::mem::take(&mut self.spare), self.threads);
            self.tested +=
                self.whole.pairs_then(&self.store, (threads, &self.cancel), &mut list)?;
            Arc::clone(self.list_then.insert(Arc::new(list)))
        };
        let now = self.list_now()?;
        let states = &self.store.states;
        let found = if states.has_lost() {
            let is_another = |pair: Pair| states.has_either(pair, LOST);
            Difference::between(&then, &now, &is_another, self.threads, &self.cancel)
        } else {
            Difference::between(&then, &now, &|_| false, self.threads, &self.cancel)
        };
        self.report(found, true)
    }

    /// Reports what changed, or all pairs where they are fewer.
    fn report(&mut self, mut found: Difference, is_sorted: bool) -> Result<(), CullError> {
        if !is_sorted {
            let threads = self.threads;
            found.sort(self.whole.sorter(), self.store.boxes().len(), threads, &self.cancel);
        }
        if self.cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        let Difference { begun, ended } = found;
        let (more, less) = (begun.len() as u64, ended.len() as u64);
        self.reported.pair_count = self.count_then.saturating_add(more).saturating_sub(less);
        if is_resync_due(more + less, self.reported.pair_count) {
            return self.report_resync();
        }
        let states = &self.store.states;
        let ended = ended.into_iter().map(|pair| Ended { pair, reason: states.end_reason(pair) });
        self.reported.ended.extend(ended);
        self.reported.begun = begun;
        Ok(())
    }

    fn report_resync(&mut self) -> Result<(), CullError> {
        self.report_all()?;
        self.reported.resync = true;
        Ok(())
    }

    fn report_all(&mut self) -> Result<(), CullError> {
        let now = self.list_now()?;
        self.reported.pair_count = now.len() as u64;
        self.reported.pairs = now;
        Ok(())
    }

    fn list_now(&mut self) -> Result<Arc<Vec<Pair>>, CullError> {
        if let Some(now) = &self.list_now {
            return Ok(Arc::clone(now));
        }
        let (store, threads, cancel) = (&self.store, self.threads, &self.cancel);
        let mut list = std::mem::take(&mut self.spare);
        let states = &store.states;
        self.tested += if states.active_still() > 1 || states.filters.is_used() {
            let requested = |pair: Pair| states.may_meet(pair);
            self.whole.pairs(store.boxes(), &requested, (threads, cancel), &mut list)?
        } else {
            self.whole.pairs(store.boxes(), &|_| true, (threads, cancel), &mut list)?
        };
        let now = Arc::new(list);
        self.list_now = Some(Arc::clone(&now));
        Ok(now)
    }

    /// Reports the pairs of the boxes that the edit named: what queries by these find.
    fn report_moved(&mut self) -> Result<(), CullError> {
        let mut pairs = Vec::new();
        let named = self.store.named().len();
        if named > self.many().min(self.len() / query::REBUILT_SHARE) {
            let now = self.list_now()?;
            let is_named = |pair: &Pair| self.store.states.has_either(*pair, NAMED);
            pairs.extend(now.iter().copied().filter(is_named));
        } else if named > 0 {
            let (store, threads) = (&self.store, self.threads);
            let of = |index: &u32| store.boxes()[*index as usize];
            let queries: Vec<Aabb> = store.named().iter().map(of).collect();
            // Each finds itself, and two named ones each other.
            let most = 2 * self.whole.most_pairs() + named as u64;
            self.tested += self.find_around(&queries, most, &mut pairs)?;
            let Self { store, whole, cancel, .. } = self;
            let states = &store.states;
            pairs.retain_mut(|found| {
                let (index, other) = (store.named()[found[0] as usize], found[1]);
                let is_reported = other <= index && (other == index || states.has(other, NAMED));
                *found = pair(index, other);
                !is_reported && states.may_meet(*found)
            });
            if pairs.len() as u64 > whole.most_pairs() {
                return Err(query::more_pairs_than(whole.most_pairs()));
            }
            whole.sorter().sort(&mut pairs, store.boxes().len() as u32, threads, cancel);
        }
        if self.cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        self.reported.pairs = Arc::new(pairs);
        Ok(())
    }

    fn skips(&self) -> SceneSkips {
        let states = &self.store.states;
        let all = [states.active(), states.active_still()].map(|count| count as u64);
        let mut moved = [0, 0];
        match self.known {
            Known::Same => {}
            Known::Few => {
                for &index in self.store.changed().iter().filter(|index| states.is_active(**index))
                {
                    moved[0] += 1;
                    moved[1] += u64::from(states.has(index, STILL));
                }
            }
            Known::Many | Known::Lost => moved = all,
        }
        SceneSkips::of(all, moved, self.tested)
    }
}

/// How many threads an edit gets.
fn edit_threads(scene: &Scene, edit: Edit<'_>, report: Report) -> usize {
    let asked = scene.options.threads;
    let (named, present) = (edit.boxes(), scene.store.states.present().max(edit.boxes()));
    let is_few = report != Report::All && named <= scene.many();
    if is_few && scene.cells.is_some() {
        team::threads_by_share(named as f64 * CHANGED_NS, CHANGED_SERIAL_SHARE, asked)
    } else if is_few
        && scene.crowded.will_wait()
        && scene.worth.does_tree_pay(named, scene.account())
    {
        team::threads_for(named as f64 * CROWDED_NS, asked)
    } else {
        team::threads_for(present as f64 * WHOLE_NS, asked)
    }
}
