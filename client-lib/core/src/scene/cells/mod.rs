//! Boxes in cells: where each box of a scene lies, and which boxes lie around it.
//!
//! All entries stand in one array, by level, z, y, x of their cell, so that neighbouring cells of a
//! line are one run of it. Each cell has some free places, which no question admits: a box that moves
//! within its cell is written over, one that leaves frees its place, and one that comes takes a free
//! place of its cell, or of a cell nearby whose border then moves. Where there is none nearby, the
//! cells are built anew.

mod axis;
mod entry;
mod lanes;
mod layout;

pub(super) use self::entry::{Entry, Question};
use self::layout::Level;
use super::fetch::ask_for;
use super::store::Store;
use crate::aabb::{Aabb, KeyBox, order_key};
use crate::engine::strips::{in_parts, part_count};

/// No place.
const NOWHERE: u32 = u32::MAX;
/// Places and cells that are looked through for a free place, each way: 2 KiB, some 30 ns.
const BORROW_REACH: u32 = 64;
/// Free places of a cell at first, for each so many boxes in it, beside one.
const BOXES_A_SPARE: u32 = 6;
/// Boxes whose homes are found by one task, at least.
const TASK_BOXES: usize = 4_096;
/// Boxes whose moves are found before any is made: 512 KiB.
const STRETCH: usize = 8_192;
/// Moves found by one task, at least: some 30 µs.
const TASK_MOVES: usize = 512;
/// Searches made at a time. With 4 lines of cells each, some 100 lines of memory are under way, several
/// times what a core can have, and few enough that none is lost again.
const BATCH: usize = 16;
/// Entries of a run that are asked for ahead: further ones the processor finds by itself.
const AHEAD: u32 = 16;
/// Tests of a search that are as they should be.
const FAIR_TESTS: u64 = 96;
/// Tests beyond these, for each box, after which the layout is chosen again: about what that takes.
const UNFAIR_TESTS_A_BOX: u64 = 32;
/// Moves, for each box, after which the layout is chosen again, since boxes may have spread.
const MOVES_A_BOX: u64 = 16;

/// The cells of a scene.
#[derive(Debug, Default)]
pub(super) struct Cells {
    /// Finest first.
    levels: Vec<Level>,
    /// Entries of each level.
    occupied: Vec<u32>,
    /// First place of each cell of all levels, and the end of the last one.
    starts: Vec<u32>,
    entries: Vec<Entry>,
    /// Place of each box by index, [`NOWHERE`] for one that overlaps nothing.
    places: Vec<u32>,
    /// Moves since the layout was chosen.
    move_count: u64,
    /// Tests of searches since then, and searches.
    tests: u64,
    searches: u64,
    /// Memory of the moves under way.
    moves: Vec<Move>,
}

/// Memory of searches, kept from one to the next.
#[derive(Debug, Default)]
pub(super) struct SearchMemory {
    /// Runs of cells, then of places.
    runs: Vec<[u32; 2]>,
    /// Indices found by one search.
    hit: Vec<u32>,
}

/// Where a box goes.
#[derive(Clone, Copy, Debug)]
struct Move {
    /// [`Entry::FREE`] for a box that overlaps nothing now.
    entry: Entry,
    home: Home,
    index: u32,
}

impl Move {
    const NONE: Self = Self { entry: Entry::FREE, home: Home { cell: 0, level: 0 }, index: 0 };
}

/// A cell and its level.
#[derive(Clone, Copy, Debug)]
struct Home {
    cell: u32,
    level: u32,
}

/// The coordinate of a key: the map to keys is its own inverse, but for −0.
#[inline(always)]
fn coordinate(key: i32) -> f32 {
    f32::from_bits(order_key(key as u32) as u32)
}

impl Cells {
    /// The cells of the boxes of a scene.
    pub fn of(boxes: &[Aabb], is_static: impl Fn(u32) -> bool, threads: usize) -> Self {
        let mut cells = Self::default();
        cells.build(boxes, is_static, threads);
        cells
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        let words = self.starts.capacity() + self.places.capacity() + self.occupied.capacity();
        words * size_of::<u32>() + self.entries.capacity() * size_of::<Entry>()
    }

    /// Where a box lies in memory: boxes near each other in space have numbers near each other.
    #[inline]
    pub fn place(&self, index: u32) -> u32 {
        self.places.get(index as usize).copied().unwrap_or(NOWHERE)
    }

    /// Chooses the layout anew and places every box.
    fn build(&mut self, boxes: &[Aabb], is_static: impl Fn(u32) -> bool, threads: usize) {
        self.levels = layout::choose(boxes);
        let cell_count =
            self.levels.last().map_or(0, |level| level.first_cell + level.cell_count()) as usize;
        let homes = self.homes_of(boxes, threads);
        self.occupied.clear();
        self.occupied.resize(self.levels.len(), 0);
        let mut counts = vec![0u32; cell_count + 1];
        for home in &homes {
            if home.cell != NOWHERE {
                counts[home.cell as usize] += 1;
                self.occupied[home.level as usize] += 1;
            }
        }
        self.starts.clear();
        self.starts.reserve_exact(cell_count + 1);
        let mut next = 0;
        for count in &mut counts {
            self.starts.push(next);
            let here = *count;
            *count = next;
            next += if here == 0 { 0 } else { here + 1 + here / BOXES_A_SPARE };
        }
        self.entries.clear();
        self.entries.reserve_exact(next as usize);
        self.entries.resize(next as usize, Entry::FREE);
        self.places.clear();
        self.places.resize(boxes.len(), NOWHERE);
        for ((index, home), place) in (0u32..).zip(&homes).zip(&mut self.places) {
            if home.cell != NOWHERE {
                let next = &mut counts[home.cell as usize];
                *place = *next;
                let key = KeyBox::from(&boxes[index as usize]);
                self.entries[*next as usize] = Entry::new(&key, is_static(index), index);
                *next += 1;
            }
        }
        (self.move_count, self.tests, self.searches) = (0, 0, 0);
    }

    fn homes_of(&self, boxes: &[Aabb], threads: usize) -> Vec<Home> {
        let nowhere = Home { cell: NOWHERE, level: 0 };
        let mut homes = vec![nowhere; boxes.len()];
        let parts = part_count(boxes.len(), TASK_BOXES, threads);
        let mut work: Vec<(&mut [Home], &[Aabb])> = Vec::with_capacity(parts);
        let step = boxes.len().div_ceil(parts).max(1);
        work.extend(homes.chunks_mut(step).zip(boxes.chunks(step)));
        let run = |work: &mut [(&mut [Home], &[Aabb])]| {
            for (home, b) in work.iter_mut().flat_map(|(homes, boxes)| homes.iter_mut().zip(*boxes))
            {
                let key = KeyBox::from(b);
                if key != KeyBox::NOTHING {
                    *home = self.home(&key);
                }
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
        homes
    }

    /// The first level that takes a box, and its cell there; the last one takes all.
    #[inline]
    fn home(&self, key: &KeyBox) -> Home {
        let (min, max) = (key.min.map(coordinate), key.max.map(coordinate));
        for (number, level) in self.levels.iter().enumerate() {
            if let Some(cell) = level.home(min, max) {
                return Home { cell, level: number as u32 };
            }
        }
        let last = self.levels.len() - 1;
        Home { cell: self.levels[last].first_cell, level: last as u32 }
    }

    /// Moves boxes to where they are now.
    pub fn update(&mut self, store: &Store, changed: [&[u32]; 2], threads: usize) {
        self.places.resize(store.boxes().len().max(self.places.len()), NOWHERE);
        let mut moves = std::mem::take(&mut self.moves);
        let mut have_room = true;
        for some in changed.iter().flat_map(|indices| indices.chunks(STRETCH)) {
            self.move_count += some.len() as u64;
            if have_room {
                self.find_moves(store, some, &mut moves, threads);
                have_room = moves.chunks(BATCH).all(|batch| self.move_boxes(batch));
            }
        }
        self.moves = moves;
        if !have_room || self.is_stale(store) {
            self.build(store.boxes(), |index| store.is_static(index), threads);
        }
    }

    /// Where boxes are now.
    fn find_moves(&self, store: &Store, indices: &[u32], moves: &mut Vec<Move>, threads: usize) {
        moves.resize(indices.len(), Move::NONE);
        let parts = part_count(indices.len(), TASK_MOVES, threads);
        let step = indices.len().div_ceil(parts).max(1);
        let mut work: Vec<(&mut [Move], &[u32])> =
            moves.chunks_mut(step).zip(indices.chunks(step)).collect();
        let run = |work: &mut [(&mut [Move], &[u32])]| {
            for (moves, indices) in work {
                for (at, (slot, index)) in moves.iter_mut().zip(*indices).enumerate() {
                    if let Some(ahead) = indices.get(at + BATCH) {
                        ask_for(store.boxes(), *ahead);
                    }
                    let b = &store.boxes()[*index as usize];
                    let entry = Entry::of(b, store.is_static(*index), *index);
                    let nowhere = Home { cell: 0, level: 0 };
                    let home = if entry.is_free() { nowhere } else { self.home(&entry.key()) };
                    *slot = Move { entry, home, index: *index };
                }
            }
        };
        in_parts(work.as_mut_slice(), parts, &run, &|(), ()| ());
    }

    /// Whether the layout is to be chosen again.
    fn is_stale(&self, store: &Store) -> bool {
        let boxes = store.present() as u64 + TASK_BOXES as u64;
        let unfair = self.tests.saturating_sub(self.searches * FAIR_TESTS);
        self.move_count > MOVES_A_BOX * boxes || unfair > UNFAIR_TESTS_A_BOX * boxes
    }

    /// Moves up to [`BATCH`] boxes. False when a box found no place.
    fn move_boxes(&mut self, moves: &[Move]) -> bool {
        for this in moves {
            ask_for(&self.places, this.index);
            ask_for(&self.starts, this.home.cell);
        }
        for this in moves {
            ask_for(&self.entries, self.places[this.index as usize]);
            ask_for(&self.entries, self.starts[this.home.cell as usize]);
        }
        moves.iter().all(|this| self.move_box(this))
    }

    /// Moves one box. False when no free place is near its cell; the box has none then.
    fn move_box(&mut self, Move { entry, home, index }: &Move) -> bool {
        let place = self.places[*index as usize];
        if entry.is_free() {
            if place != NOWHERE {
                self.free(*index, place);
            }
            return true;
        }
        let (start, end) = (self.starts[home.cell as usize], self.starts[home.cell as usize + 1]);
        if (start..end).contains(&place) {
            self.entries[place as usize] = *entry;
            return true;
        }
        if place != NOWHERE {
            self.free(*index, place);
        }
        let here = &self.entries[start as usize..end as usize];
        let free = here.iter().position(Entry::is_free).map(|at| start + at as u32);
        let Some(free) = free.or_else(|| self.borrow(home.cell)) else { return false };
        self.entries[free as usize] = *entry;
        self.places[*index as usize] = free;
        self.occupied[home.level as usize] += 1;
        true
    }

    fn free(&mut self, index: u32, place: u32) {
        self.entries[place as usize] = Entry::FREE;
        self.places[index as usize] = NOWHERE;
        let level = self.level_of_place(place);
        self.occupied[level] -= 1;
    }

    /// The level that a place belongs to.
    fn level_of_place(&self, place: u32) -> usize {
        let begins = |level: &Level| self.starts[level.first_cell as usize];
        self.levels.iter().rposition(|level| begins(level) <= place).unwrap_or(0)
    }

    /// Moves a free place from a cell nearby into a full cell.
    fn borrow(&mut self, cell: u32) -> Option<u32> {
        self.borrow_from_later(cell).or_else(|| self.borrow_from_earlier(cell))
    }

    fn borrow_from_later(&mut self, cell: u32) -> Option<u32> {
        let end = self.starts[cell as usize + 1];
        let reach = (end + BORROW_REACH).min(self.entries.len() as u32);
        let near = &self.entries[end as usize..reach as usize];
        let mut free = end + near.iter().position(Entry::is_free)? as u32;
        let last_cell = (cell + BORROW_REACH).min(self.starts.len() as u32 - 2);
        let mut lender = cell + 1;
        while lender <= last_cell && self.starts[lender as usize + 1] <= free {
            lender += 1;
        }
        if lender > last_cell {
            return None;
        }
        // From the lender down, each cell gives its first place to the cell before it.
        for giver in (cell + 1..=lender).rev() {
            let first = self.starts[giver as usize];
            if first != free {
                self.shift(first, free);
                free = first;
            }
            self.starts[giver as usize] = first + 1;
        }
        Some(free)
    }

    fn borrow_from_earlier(&mut self, cell: u32) -> Option<u32> {
        let start = self.starts[cell as usize];
        let reach = start.saturating_sub(BORROW_REACH);
        let near = &self.entries[reach as usize..start as usize];
        let mut free = reach + near.iter().rposition(Entry::is_free)? as u32;
        let first_cell = cell.saturating_sub(BORROW_REACH);
        let mut lender = cell.checked_sub(1)?;
        while lender > first_cell && self.starts[lender as usize] > free {
            lender -= 1;
        }
        if self.starts[lender as usize] > free {
            return None;
        }
        // From the lender up, each cell gives its last place to the cell after it.
        for giver in lender..cell {
            let last = self.starts[giver as usize + 1] - 1;
            if last != free {
                self.shift(last, free);
                free = last;
            }
            self.starts[giver as usize + 1] = last;
        }
        Some(free)
    }

    /// Moves an entry to a free place.
    fn shift(&mut self, from: u32, to: u32) {
        let entry = std::mem::replace(&mut self.entries[from as usize], Entry::FREE);
        self.entries[to as usize] = entry;
        // A place between the free one and a border may be free as well.
        if !entry.is_free() {
            self.places[entry.index() as usize] = to;
        }
    }

    /// Counts searches and their tests, by which the layout is judged.
    pub fn note_searches(&mut self, searches: u64, tests: u64) {
        self.searches += searches;
        self.tests += tests;
    }

    /// Calls `found` for each box that is a pair with one of `indices`, by the entries as they are now:
    /// with the place in `indices`, in order, and the other's index. Returns how many entries were
    /// tested. Needs the default floating-point flags.
    ///
    /// Some searches are made at a time, step by step, so that their misses of the caches overlap.
    #[inline]
    pub fn around_each(
        &self,
        indices: &[u32],
        SearchMemory { runs, hit }: &mut SearchMemory,
        mut found: impl FnMut(usize, u32),
    ) -> u64 {
        let mut tested = 0;
        for (batch, some) in indices.chunks(BATCH).enumerate() {
            for index in some {
                ask_for(&self.places, *index);
            }
            let mut places = [NOWHERE; BATCH];
            for (place, index) in places.iter_mut().zip(some) {
                *place = self.place(*index);
                ask_for(&self.entries, *place);
            }
            runs.clear();
            let mut questions = [Question::NONE; BATCH];
            let mut ends = [0; BATCH];
            for ((place, question), end) in places.iter().zip(&mut questions).zip(&mut ends) {
                if let Some(this) = self.entries.get(*place as usize) {
                    let key = this.key();
                    *question = Question::of(this);
                    self.cells_around(&key, |cells| {
                        ask_for(&self.starts, cells[0]);
                        runs.push(cells);
                    });
                }
                *end = runs.len();
            }
            for run in &mut *runs {
                *run = run.map(|cell| self.starts[cell as usize]);
                let ahead = run[1].min(run[0] + AHEAD);
                (run[0]..ahead).step_by(2).for_each(|place| ask_for(&self.entries, place));
            }
            let mut start = 0;
            for (at, index) in some.iter().enumerate() {
                let mut hits = 0;
                for [first, end] in &runs[start..ends[at]] {
                    let run = &self.entries[*first as usize..*end as usize];
                    tested += run.len() as u64;
                    if hit.len() < hits + run.len() {
                        hit.resize(2 * (hits + run.len()), 0);
                    }
                    // Without a branch on what hits: it would be mispredicted each time.
                    for entry in run {
                        hit[hits] = entry.index();
                        hits += usize::from(questions[at].admits(entry));
                    }
                }
                for other in hit[..hits].iter().filter(|other| *other != index) {
                    found(batch * BATCH + at, *other);
                }
                start = ends[at];
            }
        }
        tested
    }

    /// Calls `run` with each run of cells, first and end, in which a box may have partners.
    #[inline(always)]
    fn cells_around(&self, key: &KeyBox, mut run: impl FnMut([u32; 2])) {
        let (min, max) = (key.min.map(coordinate), key.max.map(coordinate));
        for (level, occupied) in self.levels.iter().zip(&self.occupied) {
            if *occupied == 0 {
                continue;
            }
            let [xs, ys, zs] = std::array::from_fn(|axis| {
                let of = &level.axes[axis];
                of.cells(of.fine(min[axis]) - 1, of.fine(max[axis]))
            });
            if lines(&ys) * lines(&zs) > u64::from(*occupied) {
                run([level.first_cell, level.first_cell + level.cell_count()]);
                continue;
            }
            if xs[1].is_empty() && ys[1].is_empty() && zs[1].is_empty() {
                let [[x, _], [y, _], [z, _]] = [xs, ys, zs];
                let (width, cells) = (level.axes[0].count, x.end - x.start);
                for z in z {
                    let first = level.cell_at(x.start, y.start, z);
                    for line in 0..y.end - y.start {
                        let cell = first + line * width;
                        run([cell, cell + cells]);
                    }
                }
                continue;
            }
            for z in zs.into_iter().flatten() {
                for y in ys.iter().cloned().flatten() {
                    for x in &xs {
                        if x.start < x.end {
                            let cell = level.cell_at(x.start, y, z);
                            run([cell, cell + (x.end - x.start)]);
                        }
                    }
                }
            }
        }
    }
}

/// Cells of an axis that a search spans.
fn lines(ranges: &[std::ops::Range<u32>; 2]) -> u64 {
    ranges.iter().map(|range| u64::from(range.end - range.start)).sum()
}
