//! Looking around boxes: which boxes lie in the cells where partners may be, and may overlap.
//!
//! A batch of searches is made in three steps: each asks for the memory that the next one reads. Steps of
//! other batches between them give it the time to come.

use std::ops::Range;

use super::Cells;
use super::admit::{Hit, Span, admit};
use super::block::{Question, SLOTS};
use super::layout::Level;
use crate::aabb::Aabb;
use crate::aabb::is_valid;

/// Blocks of a run that are asked for ahead: further ones the processor finds by itself.
const AHEAD: u32 = 8;
/// Spans that there is room for at first, 12 bytes each: those of a few searches.
const SPANS_LEAST: usize = 64;

/// A search around valid boxes.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) enum Probe {
    /// Around two boxes at once, near each other. Where `dismisses`, boxes are of no interest that have
    /// not changed, and overlap both or neither.
    Both { was: Aabb, is: Aabb, dismisses: bool },
    /// Around one of two boxes. The other one may be empty.
    One { here: Aabb, elsewhere: Aabb },
}

/// A box that a probe may have to do with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::scene) struct Candidate {
    /// Place of the probe among those of the batch.
    pub probe: u32,
    /// Its index and flags.
    pub word: u32,
    /// It has not changed, overlaps the box `here` for sure, and for sure not the one `elsewhere`.
    pub is_sure: bool,
}

/// A batch of searches under way: [begun](Cells::begin), then [on](Cells::go_on), then
/// [finished](Cells::finish).
#[derive(Debug, Default)]
pub(in crate::scene) struct Searches {
    questions: Vec<Question>,
    /// Which of those that a question dismisses are sure.
    sure: Vec<Sure>,
    /// Probe of each question.
    probes: Vec<u32>,
    lines: Vec<Line>,
    /// Spans, and behind them what is left of others.
    spans: Vec<Span>,
    span_count: usize,
    /// Boxes of the spans.
    tested: u64,
    levels: Vec<usize>,
}

/// Neighbouring cells.
#[derive(Clone, Copy, Debug)]
struct Line {
    question: u32,
    first: u32,
    count: u32,
}

/// Of boxes that have not changed and overlap a box for sure: which of them are sure not to overlap another.
#[derive(Clone, Copy, Debug)]
enum Sure {
    /// None: they are of no interest.
    None,
    All,
    /// Those that a question does not admit.
    Unless(Question),
}

impl Searches {
    fn clear(&mut self) {
        self.questions.clear();
        self.sure.clear();
        self.probes.clear();
        self.lines.clear();
    }

    /// Boxes that will be tested, where the searches went [on](Cells::go_on): no more of them are found.
    pub const fn tested(&self) -> u64 {
        self.tested
    }

    pub fn allocated_bytes(&self) -> usize {
        self.questions.capacity() * size_of::<Question>()
            + self.sure.capacity() * size_of::<Sure>()
            + self.probes.capacity() * size_of::<u32>()
            + self.lines.capacity() * size_of::<Line>()
            + self.spans.capacity() * size_of::<Span>()
            + self.levels.capacity() * size_of::<usize>()
    }
}

impl Cells {
    /// Begins to look around some probes: finds the cells. Needs the default floating-point flags, which
    /// are those that boxes were placed with.
    pub fn begin(&self, probes: &[Probe], searches: &mut Searches) {
        searches.clear();
        for (at, probe) in (0u32..).zip(probes) {
            for (level, occupied) in self.levels.iter().zip(&self.occupied) {
                if *occupied > 0 {
                    self.begin_in(level, at, probe, searches);
                }
            }
        }
    }

    /// Begins to look around a probe in a level.
    fn begin_in(&self, level: &Level, at: u32, probe: &Probe, searches: &mut Searches) {
        let Searches { questions, sure, probes: of_questions, lines, .. } = searches;
        let question = questions.len() as u32;
        if level.takes_all {
            of_questions.push(at);
            questions.push(Question::ALL);
            sure.push(Sure::None);
            lines.push(Line { question, first: level.first_cell, count: 1 });
            return;
        }
        let (was, is) = match probe {
            Probe::Both { was, is, .. } => (level.quanta(was), level.quanta(is)),
            Probe::One { here, .. } => {
                let here = level.quanta(here);
                (here, here)
            }
        };
        let hull = was.hull(&is);
        if level.is_beyond(&hull) {
            return;
        }
        of_questions.push(at);
        let of_axis = |axis: usize| level.axes[axis].cells(hull.min[axis], hull.max[axis]);
        // One by one: `array::from_fn` is not inlined here.
        let ranges = [of_axis(0), of_axis(1), of_axis(2)];
        let (dismisses, those) = match probe {
            Probe::Both { dismisses, .. } => (*dismisses, Sure::None),
            Probe::One { elsewhere, .. } => {
                let are_bounded = (0..3).all(|axis| level.axes[axis].are_bounded(&ranges[axis]));
                if !are_bounded {
                    (false, Sure::None)
                } else if is_valid(elsewhere) {
                    let there = level.quanta(elsewhere);
                    (true, Sure::Unless(Question::new(&there, &there, false)))
                } else {
                    (true, Sure::All)
                }
            }
        };
        questions.push(Question::new(&was, &is, dismisses));
        sure.push(those);
        let [xs, ys, zs] = ranges;
        let mut add = |[x, y, z]: [&Range<u32>; 3]| {
            for z in z.clone() {
                for y in y.clone() {
                    let first = level.cell_at(x.start, y, z);
                    let count = x.end - x.start;
                    // Both ends: a few runs lie on two lines of the cache as often as not.
                    self.runs.ask_for_run(first);
                    self.runs.ask_for_run(first + count - 1);
                    lines.push(Line { question, first, count });
                }
            }
        };
        add([&xs[0], &ys[0], &zs[0]]);
        if !(xs[1].is_empty() && ys[1].is_empty() && zs[1].is_empty()) {
            for parts in 1..8 {
                let part = [parts & 1, parts >> 1 & 1, parts >> 2];
                let of = [&xs[part[0]], &ys[part[1]], &zs[part[2]]];
                if of.iter().all(|range| !range.is_empty()) {
                    add(of);
                }
            }
        }
    }

    /// [Begins](Self::begin) to look around valid boxes: as around one of two of which the other is empty, without
    /// the hulls and second ranges of cells that others need.
    pub fn begin_around(&self, boxes: &[Aabb], searches: &mut Searches) {
        searches.clear();
        let mut levels = std::mem::take(&mut searches.levels);
        levels.clear();
        levels.extend((0..self.levels.len()).filter(|number| self.occupied[*number] > 0));
        for (at, b) in (0u32..).zip(boxes) {
            for number in &levels {
                let level = &self.levels[*number];
                let Some(around) = level.around(b) else {
                    let probe = Probe::One { here: *b, elsewhere: Aabb::EMPTY };
                    self.begin_in(level, at, &probe, searches);
                    continue;
                };
                if level.is_beyond(&around.q) {
                    continue;
                }
                let Searches { questions, sure, probes, lines, .. } = &mut *searches;
                let question = questions.len() as u32;
                questions.push(Question::new(&around.q, &around.q, around.is_bounded));
                sure.push(if around.is_bounded { Sure::All } else { Sure::None });
                probes.push(at);
                let ([x, y, z, _], [last_x, last_y, last_z, _]) = (around.first, around.last);
                let count = (last_x - x + 1) as u32;
                for z in z..=last_z {
                    let mut first = level.cell_at(x as u32, y as u32, z as u32);
                    for _ in y..=last_y {
                        self.runs.ask_for_run(first);
                        self.runs.ask_for_run(first + count - 1);
                        lines.push(Line { question, first, count });
                        first += level.axes[0].count;
                    }
                }
            }
        }
        searches.levels = levels;
    }

    /// Goes on: finds the blocks.
    pub fn go_on(&self, Searches { lines, spans, span_count, tested, .. }: &mut Searches) {
        let mut count = 0;
        *tested = 0;
        for &Line { question, first, count: cells } in &*lines {
            for run in self.runs.runs(first, cells) {
                if spans.len() < count + 2 {
                    spans.resize(2 * spans.len() + SPANS_LEAST, Span::default());
                }
                // How many boxes a cell has is as good as random: up to two blocks, nothing branches on it.
                let (start, len) = (run.start, run.len);
                *tested += u64::from(len);
                self.runs.ask_for_block(start);
                self.runs.ask_for_block(start + u32::from(len > SLOTS));
                spans[count] = Span { question, start, len: len.min(SLOTS) };
                spans[count + 1] =
                    Span { question, start: start + 1, len: len.saturating_sub(SLOTS) };
                count += usize::from(len > 0) + usize::from(len > SLOTS);
                if len > 2 * SLOTS {
                    for block in 2..run.blocks().min(AHEAD) {
                        self.runs.ask_for_block(start + block);
                    }
                }
            }
        }
        *span_count = count;
    }

    /// Ends: adds the boxes that may be partners of a probe, all that overlap, by the slots as they are,
    /// and some that do not. Each probe finds its own box as well. Returns how many boxes were tested.
    pub fn finish(&self, searches: &Searches, found: &mut Vec<Candidate>) -> u64 {
        let Searches { questions, spans, span_count, tested, .. } = searches;
        admit(self.runs.blocks(), questions, &spans[..*span_count], &mut |hits| {
            self.add(searches, hits, found);
        });
        *tested
    }

    /// Adds the boxes of some blocks.
    fn add(&self, searches: &Searches, hits: &[Hit], found: &mut Vec<Candidate>) {
        let Searches { questions, sure, probes, .. } = searches;
        for &Hit { question: number, block, admitted } in hits {
            let (block, probe) = (&self.runs.blocks()[block as usize], probes[number as usize]);
            let dismissed = admitted & questions[number as usize].dismissed(block);
            let (mut bits, surely) = match &sure[number as usize] {
                Sure::None => (admitted & !dismissed, 0),
                Sure::All => (admitted, dismissed),
                Sure::Unless(there) => (admitted, dismissed & !there.admitted(block)),
            };
            while bits != 0 {
                let word = block.0[bits.trailing_zeros() as usize / 8].word();
                let is_sure = surely & bits & bits.wrapping_neg() != 0;
                found.push(Candidate { probe, word, is_sure });
                bits &= bits - 1;
            }
        }
    }
}
