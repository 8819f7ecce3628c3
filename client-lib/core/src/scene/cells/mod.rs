//! Boxes in cells: where each box of a scene lies, and which boxes lie around it.
//!
//! A cell has a run of [blocks](block), filled from the front. A box that moves within its cell is
//! written over; one that leaves is replaced by the last of its cell, and one that comes is put behind the
//! last. A cell without room gets a longer run elsewhere, and its old one goes to another.
//!
//! While a box has changed since the history began, its slot holds the hull of what it was and what it
//! is, so that one search finds the pairs that it had and has. Where the hull is too long for the level,
//! two slots hold the two. The first update after [`Cells::discard`] ends that.

mod admit;
mod axis;
mod block;
mod build;
mod ghosts;
mod layout;
mod quanta;
mod runs;
mod search;
mod stages;

pub(super) use self::block::{CHANGED, INDEX, STATIC};
pub(super) use self::search::{Candidate, Probe, Searches};
pub(super) use self::stages::{BATCH, BATCHES, Looked, in_stages};
pub(super) use crate::aabb::is_valid;

use self::block::Slot;
use self::ghosts::Ghosts;
use self::layout::Level;
use self::quanta::Quanta;
use self::runs::{NOWHERE, Runs};
use super::states;
use super::store::Store;
use crate::aabb::Aabb;
use crate::fetch::ask_for;
use crate::team::zip_in_parts;

/// Boxes whose moves are found before any is made: 384 KiB.
const STRETCH: usize = 8_192;
/// Moves found by one task, at least: some 30 µs.
const TASK_MOVES: usize = 512;
/// Moves made at a time, so that their misses of the caches overlap.
const MOVES: usize = 16;
/// Tests of a search that are as they should be, in any case; else so many eighths of those of the first searches in a
/// layout.
const FAIR_TESTS: u64 = 96;
const FAIR_GROWTH: u64 = 12;
const FAIR_SEARCHES: u64 = 256;
/// Tests beyond these, for each box, after which the layout is chosen again: about what that takes.
const UNFAIR_TESTS_A_BOX: u64 = 32;
/// Moves, for each box, after which the layout is chosen again, since boxes may have spread.
const MOVES_A_BOX: u64 = 16;
/// Boxes that may always move before the layout is chosen again.
const BOXES_LEAST: u64 = 4_096;

#[derive(Debug, Default)]
pub(super) struct Cells {
    /// Finest first.
    levels: Vec<Level>,
    /// Boxes of each level.
    occupied: Vec<u32>,
    runs: Runs,
    /// Place of each box by index, [`NOWHERE`] for one that overlaps nothing.
    positions: Vec<u32>,
    /// Places of what boxes were that have a slot of their own for that.
    ghosts: Ghosts,
    /// Boxes whose slots hold hulls of a history that has ended.
    settling: Vec<u32>,
    /// Moves since the layout was chosen.
    move_count: u64,
    /// Tests of searches since then, and searches.
    tests: u64,
    searches: u64,
    /// Tests of a search that are as they should be; 0 while that is not known.
    fair_tests: u64,
    /// Memory of the moves under way.
    moves: Vec<Move>,
}

/// What becomes of a box.
#[derive(Clone, Copy, Debug)]
enum Action {
    Stay,
    /// It overlaps nothing any more.
    Leave,
    /// Its slot is written over, where it is.
    Settle,
    /// It goes to a cell of a level.
    Go,
    /// The same, and its old slot stays for what it was.
    Part,
}

/// Where a box goes.
#[derive(Clone, Copy, Debug)]
struct Move {
    slot: Slot,
    index: u32,
    cell: u32,
    level: u32,
    action: Action,
}

impl Move {
    const NONE: Self = Self { slot: Slot::NONE, index: 0, cell: 0, level: 0, action: Action::Stay };
}

/// What becomes of the box of an index.
type MoveOf = fn(&Cells, &Store, u32) -> Option<Move>;

/// The first level that takes a valid box, and the box in its quanta.
#[inline(always)]
fn level_of(levels: &[Level], b: &Aabb) -> (usize, Quanta) {
    let last = levels.len() - 1;
    for (number, level) in levels[..last].iter().enumerate() {
        let q = level.quanta(b);
        if level.takes(&q) {
            return (number, q);
        }
    }
    (last, levels[last].quanta(b))
}

impl Cells {
    /// The cells of boxes, none of which has changed.
    pub fn of(boxes: &[Aabb], is_static: impl Fn(u32) -> bool + Sync, threads: usize) -> Self {
        let mut cells = Self::default();
        cells.build(boxes, is_static, threads);
        cells
    }

    pub fn allocated_bytes(&self) -> usize {
        let words = self.positions.capacity() + self.settling.capacity();
        words * size_of::<u32>()
            + self.runs.allocated_bytes()
            + self.moves.capacity() * size_of::<Move>()
            + self.ghosts.capacity() * (size_of::<(u32, u32)>() + 1)
    }

    /// Where a box lies in memory: boxes near each other in space have numbers near each other.
    #[inline]
    pub fn position(&self, index: u32) -> u32 {
        self.positions.get(index as usize).copied().unwrap_or(NOWHERE)
    }

    /// A number by which boxes that are near each other stand together. Needs the default flags.
    pub fn near(&self, b: &Aabb) -> u32 {
        let occupied = self.levels.iter().zip(&self.occupied).find(|(_, count)| **count > 0);
        occupied.filter(|_| is_valid(b)).map_or(0, |(level, _)| level.home(&level.quanta(b)))
    }

    /// The history begins anew: boxes that have changed are to be [settled](Self::update).
    pub fn discard(&mut self, changed: &[u32]) {
        self.settling.extend_from_slice(changed);
    }

    /// Makes slots those of what boxes were and are, after an edit that named `changed`.
    pub fn update(&mut self, store: &Store, changed: [&[u32]; 2], threads: usize) {
        self.move_all(store, changed, threads);
        if self.is_stale(store) {
            let (boxes, statics) = store.then();
            self.build(&boxes, |index| statics[index as usize], threads);
            drop((boxes, statics));
            self.move_all(store, [store.changed(), &[]], threads);
        }
    }

    /// Makes slots those of what boxes are, after an edit that named `changed`: for cells of now, which know
    /// of no history.
    pub fn follow(&mut self, store: &Store, changed: [&[u32]; 2], threads: usize) {
        self.positions.resize(store.boxes().len().max(self.positions.len()), NOWHERE);
        let mut moves = std::mem::take(&mut self.moves);
        for list in changed {
            self.move_some(store, list, Self::arrived, &mut moves, threads);
        }
        self.moves = moves;
        if self.is_stale(store) {
            self.build(store.boxes(), |index| store.states.has(index, states::STILL), threads);
        }
    }

    fn move_all(&mut self, store: &Store, changed: [&[u32]; 2], threads: usize) {
        self.positions.resize(store.boxes().len().max(self.positions.len()), NOWHERE);
        let settling = std::mem::take(&mut self.settling);
        if !settling.is_empty() {
            self.drop_ghosts();
        }
        let mut moves = std::mem::take(&mut self.moves);
        self.move_some(store, &settling, Self::settled, &mut moves, threads);
        for list in changed {
            self.move_some(store, list, Self::moved, &mut moves, threads);
        }
        self.moves = moves;
        self.settling = settling;
        self.settling.clear();
    }

    /// Makes the moves of some boxes.
    fn move_some(
        &mut self,
        store: &Store,
        indices: &[u32],
        move_of: MoveOf,
        moves: &mut Vec<Move>,
        threads: usize,
    ) {
        for some in indices.chunks(STRETCH) {
            self.move_count += some.len() as u64;
            moves.resize(some.len(), Move::NONE);
            zip_in_parts(moves, some, TASK_MOVES, threads, |moves, indices| {
                for (at, (slot, index)) in moves.iter_mut().zip(indices).enumerate() {
                    if let Some(ahead) = indices.get(at + MOVES) {
                        store.ask_for(*ahead);
                    }
                    let found = move_of(self, store, *index);
                    *slot = found.unwrap_or(Move { index: *index, ..Move::NONE });
                }
            });
            moves.chunks(MOVES).for_each(|batch| self.make_moves(batch));
        }
    }

    /// The move of a box to what it is alone, unless it has changed: its slot may stay in its cell.
    fn settled(&self, store: &Store, index: u32) -> Option<Move> {
        if store.states.has(index, states::CHANGED) {
            return None;
        }
        let to = self.arrived(store, index)?;
        let goes = matches!(to.action, Action::Go);
        Some(Move { action: if goes { Action::Settle } else { to.action }, ..to })
    }

    #[allow(clippy::unnecessary_wraps)] // As the others: a `MoveOf`.
    fn arrived(&self, store: &Store, index: u32) -> Option<Move> {
        // Of the boxes that were changed, the last may no longer exist with all indices behind.
        let b = store.boxes().get(index as usize).copied().unwrap_or(Aabb::EMPTY);
        if !is_valid(&b) {
            return Some(Move { index, action: Action::Leave, ..Move::NONE });
        }
        let (level, q) = level_of(&self.levels, &b);
        let is_still = store.states.has(index, states::STILL);
        let word = index | if is_still { STATIC } else { 0 };
        Some(self.placed(word, (level, &q), Action::Go))
    }

    /// The move of a box to what it was and is, if it has changed.
    fn moved(&self, store: &Store, index: u32) -> Option<Move> {
        let (was, is) = (store.before(index)?.b, store.boxes()[index as usize]);
        let is_split = !self.ghosts.is_empty() && self.ghosts.contains_key(&index);
        let (was_valid, is_valid) = (is_valid(&was) && !is_split, is_valid(&is));
        if !was_valid && !is_valid {
            // What it was may have its slot; what it is needs none.
            let leaves = Move { index, action: Action::Leave, ..Move::NONE };
            return (!is_split).then_some(leaves);
        }
        let (level, mut q) = level_of(&self.levels, if is_valid { &is } else { &was });
        let mut action = Action::Go;
        if was_valid && is_valid {
            let hull = q.hull(&self.levels[level].quanta(&was));
            (q, action) = if self.levels[level].takes(&hull) {
                (hull, Action::Go)
            } else {
                (q, Action::Part)
            };
        }
        Some(self.placed(index | CHANGED, (level, &q), action))
    }

    /// The move of a box with a word to its home in a level.
    fn placed(&self, word: u32, (level, q): (usize, &Quanta), action: Action) -> Move {
        let (slot, cell) = (Slot::new(q, word), self.levels[level].home(q));
        Move { slot, index: word & INDEX, cell, level: level as u32, action }
    }

    /// Makes up to [`MOVES`] moves.
    fn make_moves(&mut self, moves: &[Move]) {
        for this in moves {
            ask_for(&self.positions, this.index);
            self.runs.ask_for_run(this.cell);
        }
        for this in moves {
            let position = self.positions[this.index as usize];
            self.runs.ask_for_slot(position);
        }
        for this in moves {
            self.make_move(this);
        }
    }

    fn make_move(&mut self, &Move { slot, index, cell, level, action }: &Move) {
        let position = self.positions[index as usize];
        if position == NOWHERE {
            if matches!(action, Action::Go | Action::Part) {
                self.put(slot, cell, level);
            }
            return;
        }
        match action {
            Action::Stay => {}
            Action::Leave => self.remove(index, position),
            Action::Settle => *self.runs.slot_mut(position) = slot,
            Action::Go => {
                if self.runs.cell_of(position) == cell {
                    *self.runs.slot_mut(position) = slot;
                } else {
                    self.remove(index, position);
                    self.put(slot, cell, level);
                }
            }
            Action::Part => {
                self.runs.slot_mut(position).set_word(index | CHANGED);
                self.ghosts.insert(index, position);
                self.positions[index as usize] = NOWHERE;
                self.put(slot, cell, level);
            }
        }
    }

    /// Takes a box away from its place.
    fn remove(&mut self, index: u32, position: u32) {
        self.positions[index as usize] = NOWHERE;
        self.free(position);
    }

    fn free(&mut self, position: u32) {
        let cell = self.runs.cell_of(position);
        let level = self.levels.iter().rposition(|level| level.first_cell <= cell).unwrap_or(0);
        self.occupied[level] -= 1;
        let Self { runs, positions, ghosts, .. } = self;
        runs.remove(position, |word, from, to| note_position(positions, ghosts, word, from, to));
    }

    fn put(&mut self, slot: Slot, cell: u32, level: u32) {
        let Self { runs, positions, ghosts, .. } = self;
        let position = runs.push(cell, slot).unwrap_or_else(|| {
            runs.grow(cell, |word, from, to| note_position(positions, ghosts, word, from, to));
            // There is room now.
            runs.push(cell, slot).unwrap_or(NOWHERE)
        });
        positions[(slot.word() & INDEX) as usize] = position;
        self.occupied[level as usize] += 1;
    }

    /// Takes away what boxes were in a history that has ended.
    fn drop_ghosts(&mut self) {
        let ghosts: Vec<(u32, u32)> =
            self.ghosts.iter().map(|(i, position)| (*i, *position)).collect();
        for (at, (index, _)) in ghosts.iter().enumerate() {
            if let Some((_, ahead)) = ghosts.get(at + MOVES) {
                self.runs.ask_for_slot(*ahead);
            }
            // Where it is now: others that went may have moved it.
            if let Some(position) = self.ghosts.remove(index) {
                self.free(position);
            }
        }
    }

    /// Whether the layout is to be chosen again.
    fn is_stale(&self, store: &Store) -> bool {
        let boxes = store.states.present() as u64 + BOXES_LEAST;
        let unfair = self.tests.saturating_sub(self.searches * self.fair_tests);
        let is_unfair = self.fair_tests > 0 && unfair > UNFAIR_TESTS_A_BOX * boxes;
        self.move_count > MOVES_A_BOX * boxes || is_unfair || self.runs.are_spread()
    }

    /// Counts searches and their tests, by which the layout is judged.
    pub fn note_searches(&mut self, searches: u64, tests: u64) {
        self.searches += searches;
        self.tests += tests;
        if self.fair_tests == 0 && self.searches >= FAIR_SEARCHES {
            self.fair_tests = FAIR_TESTS.max(self.tests / self.searches * FAIR_GROWTH / 8);
        }
    }
}

/// Notes that a slot with a word has moved from one position to another.
#[inline]
fn note_position(positions: &mut [u32], ghosts: &mut Ghosts, word: u32, from: u32, to: u32) {
    let position = &mut positions[(word & INDEX) as usize];
    if *position == from {
        *position = to;
    } else if let Some(position) = ghosts.get_mut(&(word & INDEX)) {
        *position = to;
    }
}
