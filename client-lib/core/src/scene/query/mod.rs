//! Queries: which boxes of a scene overlap boxes that are not of it, such as points and sweeps; and set A
//! against set B.
//!
//! A query looks around its box in the cells that edits are searched in (`around`), where there are any. It
//! builds them where that has come to cost less than comparing each query with each box (`direct`), and edits
//! keep them right from then on. Where cells do not part the boxes, it goes down the tree of casts (`crowded`). What edits
//! report does not depend on it.
//!
//! ```text
//! how      cells or each with each, and which cells             (mod)
//! find     around, direct, crowded: pairs [query, index], sorted
//! mask     as a mask of queries and boxes, in any encoding
//! between  two sets of boxes that no scene keeps
//! cast     rays and spheres
//! ```

mod around;
mod between;
mod cast;
mod crowded;
mod direct;
mod filter_data;
mod mask;

pub use self::between::between;
pub use self::cast::{Cast, CastTree};
pub use self::filter_data::{QueryError, QueryFilterData};
pub use self::mask::{BeyondMask, QueryMask, cull_between, is_small_set};

use std::sync::atomic::{AtomicU64, Ordering};

use super::Scene;
use super::cells::Cells;
use super::pair_list::{PAIR_BYTES, Pair, starts_of};
use super::states::STILL;
use super::store::Store;
use crate::aabb::Aabb;
use crate::backoff::Backoff;
use crate::cancel::Cancel;
use crate::cast::BoxTree;
use crate::engine::{CullError, ReserveError};
use crate::team;
use crate::test_budget::TestBudget;

/// To compare so many queries with a box takes as long as to place it in cells or a tree.
const PLACED_TESTS: u64 = 64;
/// Boxes that move at once take as long as to place all anew: one in so many.
pub(super) const REBUILT_SHARE: usize = 6;
/// Comparisons that never pay for cells: 16 µs.
const FEW_TESTS: u64 = 16_384;
/// A query takes so long on one thread, ns, with its sorting.
const QUERY_NS: f64 = 500.0;
/// Tests of a query, and for each box of the scene, that searches in cells take at the most, and more for each pair
/// that they find: beyond, a tree takes less. A query among boxes that cells part tests 30 to
/// 100.
const TESTS_A_QUERY: i64 = 512;
const TESTS_A_BOX: i64 = 32;
const TESTS_A_PAIR: i64 = 16;

/// Why a query ends that finds more pairs than may be.
pub const fn more_pairs_than(most: u64) -> CullError {
    CullError::Reserve(ReserveError::TooLarge {
        at_least_bytes: PAIR_BYTES.saturating_mul(most.saturating_add(1)),
        limit_bytes: PAIR_BYTES.saturating_mul(most),
    })
}

/// How many pairs may be found, and how many boxes tested, by all threads together, and whether anybody waits for them.
struct Room<'a> {
    found: AtomicU64,
    most: u64,
    tests: TestBudget,
    cancel: &'a Cancel,
}

impl<'a> Room<'a> {
    /// For so many pairs, as queries find them among boxes.
    fn new(most: u64, queries: usize, boxes: usize, cancel: &'a Cancel) -> Self {
        let tests = TESTS_A_QUERY * queries as i64 + TESTS_A_BOX * boxes as i64;
        Self { found: AtomicU64::new(0), most, tests: TestBudget::new(tests), cancel }
    }

    /// Counts pairs that are kept, and tests that finding them took. Whether all pairs are still within the limit.
    fn take(&self, pairs: usize, tests: i64) -> bool {
        self.tests.take(tests - TESTS_A_PAIR * pairs as i64);
        // Relaxed: a number that stops a search, and that nothing is read by.
        let before = self.found.fetch_add(pairs as u64, Ordering::Relaxed);
        before + pairs as u64 <= self.most
    }

    fn is_spent(&self) -> bool {
        self.found.load(Ordering::Relaxed) > self.most || self.cancel.is_cancelled()
    }

    /// The end of a search.
    fn check(&self) -> Result<(), CullError> {
        if self.cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        if !self.is_spent() {
            return Ok(());
        }
        Err(more_pairs_than(self.most))
    }
}

/// Room for so many more pairs.
fn reserve(found: &mut Vec<Pair>, pairs: usize) -> Result<(), CullError> {
    let needed_bytes = PAIR_BYTES * pairs as u64;
    found.try_reserve(pairs).map_err(|_| ReserveError::OutOfMemory { needed_bytes }.into())
}

/// Puts pairs in the order of so many queries, and leaves those of a query in theirs: by counting.
fn by_query<'a, I: Iterator<Item = &'a Pair>>(
    pairs: impl Fn() -> I,
    queries: usize,
    starts: &mut Vec<u32>,
    found: &mut Vec<Pair>,
) {
    starts.clear();
    starts.resize(queries, 0);
    for [query, _] in pairs() {
        starts[*query as usize] += 1;
    }
    found.resize(starts_of(starts) as usize, [0; 2]);
    for pair in pairs() {
        let start = &mut starts[pair[0] as usize];
        found[*start as usize] = *pair;
        *start += 1;
    }
}

/// What a scene keeps for queries.
#[derive(Debug)]
pub(super) struct Asked {
    /// Cells of now, where edits keep none.
    cells: Option<Cells>,
    /// Comparisons of queries with boxes that cells saved, or would have, as far as boxes that moved have not cost as much,
    /// and up to what it takes to place all.
    saved: u64,
    most_pairs: u64,
    memory: around::Memory,
    /// How long queries do without cells, which did not part the boxes.
    crowded: Backoff,
    casts: CastTree,
}

impl Default for Asked {
    fn default() -> Self {
        Self {
            cells: None,
            saved: 0,
            most_pairs: u64::from(u32::MAX),
            memory: around::Memory::default(),
            crowded: Backoff::NONE,
            casts: CastTree::default(),
        }
    }
}

impl Asked {
    pub fn allocated_bytes(&self) -> usize {
        self.cells.as_ref().map_or(0, Cells::allocated_bytes)
            + self.memory.allocated_bytes()
            + self.casts.allocated_bytes()
    }

    /// The tree of a scene's boxes as they are, for searches around the changed ones; `None` where nobody waits for it.
    pub fn tree(&mut self, store: &Store, threads: usize, cancel: &Cancel) -> Option<&BoxTree> {
        self.casts.tree(store.boxes(), store.changed().len(), threads, cancel)
    }

    /// Cells were dropped: what they saved has paid for them.
    pub const fn spend_all(&mut self) {
        self.saved = 0;
    }

    /// Cells of edits serve queries too from now on.
    pub fn drop_cells(&mut self) {
        self.cells = None;
    }
}

impl Scene {
    /// Finds the boxes that some other boxes overlap and, where those have filter data, may meet by the filters, but for
    /// the include and the exclude list: a query has no index. Pairs [query, index], by query and then by index, the
    /// same on any number of threads. Boxes that are disabled are not found; static ones are. Returns how
    /// many boxes were tested.
    ///
    /// A query changes nothing that edits report.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmask_core::filters::{FilterData, World};
    /// use pairmask_core::scene::{Edit, QueryFilterData, Scene, SceneOptions, Sets, Step, FilterDataSets, Report};
    ///
    /// let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 2];
    /// let worlds = [3, 4].map(|world| FilterData::default().with_world(World(world)));
    /// let mut scene = Scene::new(SceneOptions::default());
    /// let set = Step::Set(Sets { indices: (7..9).into(), boxes: &boxes });
    /// let filter_data = FilterDataSets { indices: (7..9).into(), filter_data: &worlds };
    /// scene.edit(Edit { steps: &[set, Step::FilterData(filter_data)] }, Report::Nothing)?;
    ///
    /// let mut found = Vec::new();
    /// scene.query(&[Aabb::point([0.5; 3]), Aabb::point([9.0; 3])], QueryFilterData::None, &mut found)?;
    /// assert_eq!(found, [[0, 7], [0, 8]]);
    /// scene.query(&[Aabb::point([0.5; 3])], QueryFilterData::One(worlds[1]), &mut found)?;
    /// assert_eq!(found, [[0, 8]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`QueryError::FilterData`]; [`CullError::Reserve`] where there are more pairs than
    /// [may be](Self::limit_query_pairs), or there is no memory for them; [`CullError::Cancelled`], which changes nothing.
    pub fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        found: &mut Vec<Pair>,
    ) -> Result<u64, QueryError> {
        filter_data.check(queries.len())?;
        found.clear();
        if queries.is_empty() || self.store.boxes().is_empty() {
            return Ok(0);
        }
        self.threads = team::threads_for(queries.len() as f64 * QUERY_NS, self.options.threads);
        let _team = team::enter(self.threads);
        let tested = self.find_around(queries, self.asked.most_pairs, found)?;
        filter_data.filter(self.filters(), |index| self.store.states.has(index, STILL), found);
        Ok(tested)
    }

    /// The same of all boxes that queries overlap, whatever their filters: at most so many pairs.
    pub(super) fn find_around(
        &mut self,
        queries: &[Aabb],
        most_pairs: u64,
        found: &mut Vec<Pair>,
    ) -> Result<u64, CullError> {
        let is_crowded = self.asked.crowded.is_waiting();
        let is_compared = self.is_soonest_compared(queries.len(), is_crowded);
        if !is_compared && !is_crowded {
            self.build_cells();
        }
        let (threads, boxes) = (self.threads, self.store.boxes());
        let room = || Room::new(most_pairs, queries.len(), boxes.len(), &self.cancel);
        let (in_cells, in_tree) = (room(), room());
        let Asked { cells: of_now, memory, crowded, casts, .. } = &mut self.asked;
        let tested = match self.cells.as_ref().or(of_now.as_ref()) {
            _ if is_compared => Some(direct::find(boxes, queries, threads, &in_cells, found)?),
            Some(cells) if !is_crowded => {
                let tested =
                    around::find(cells, boxes, queries, threads, &in_cells, memory, found)?;
                if tested.is_some() {
                    *crowded = Backoff::NONE;
                } else {
                    crowded.failed();
                    *of_now = None;
                }
                tested
            }
            _ => None,
        };
        if let Some(tested) = tested {
            return Ok(tested);
        }
        let tree =
            casts.tree(boxes, queries.len(), threads, &self.cancel).ok_or(CullError::Cancelled)?;
        crowded::find(tree, boxes, queries, threads, &in_tree, found)
    }

    /// Most pairs that later queries may find; 2^32 − 1 unless set.
    pub fn limit_query_pairs(&mut self, most: u64) {
        self.asked.most_pairs = most.min(u64::from(u32::MAX));
    }

    /// Whether so many queries are soonest compared with each box: where there are neither cells nor, in their place, a
    /// tree that is right, and comparisons so far do not pay for them.
    fn is_soonest_compared(&mut self, queries: usize, is_crowded: bool) -> bool {
        let Asked { cells, casts, saved, .. } = &mut self.asked;
        let is_ready =
            if is_crowded { casts.is_right() } else { self.cells.is_some() || cells.is_some() };
        let boxes = self.store.boxes().len() as u64;
        let enough = (PLACED_TESTS * boxes).max(FEW_TESTS);
        *saved = (*saved + queries as u64 * boxes).min(enough);
        !is_ready && *saved < enough
    }

    /// Builds cells where there are none. Those of edits where nothing has changed since the last taken answer, since then
    /// they are the cells of now, and edits are small.
    fn build_cells(&mut self) {
        if self.cells.is_some() || self.asked.cells.is_some() {
            return;
        }
        let (store, threads) = (&self.store, self.threads);
        let cells = Cells::of(store.boxes(), |index| store.states.has(index, STILL), threads);
        // Those of edits that search in cells.
        if self.is_settled() && self.was_small && !self.crowded.will_wait() {
            self.cells = Some(cells);
        } else {
            self.asked.cells = Some(cells);
        }
    }

    /// Notes for queries that the last edit has changed boxes: before the cells of edits are.
    pub(super) fn note_for_queries(&mut self) {
        let (store, threads) = (&self.store, self.threads);
        let moved = [store.ended(), store.named()];
        let Asked { cells, casts, saved, .. } = &mut self.asked;
        casts.note(moved, store.boxes().len());
        let count = moved[0].len() + moved[1].len();
        *saved = saved.saturating_sub(PLACED_TESTS * count as u64);
        // Where many boxes move, cells are sooner built anew when somebody asks; where nobody asks any more, they cost
        // more than they save.
        if *saved == 0 || count > store.states.present() / REBUILT_SHARE {
            if cells.take().is_some() {
                *saved = 0;
            }
        } else if let Some(cells) = cells {
            cells.follow(store, moved, threads);
        }
    }
}
