//! What a program does in a tick: the boxes of each tick, where any session could serve them, else the requests as they
//! were recorded.

use std::io::Read;
use std::ops::Range;

use pairmask_core::{Aabb, BoxClass};
use pairmask_wire::{Page, Reject, Request};

use super::stream;
use crate::recording::{AskedFrame, ReadError, Recording};
use crate::scene::{Random, Scene};

/// Ticks that are measured again and again. More would only take memory.
const MOST_TICKS: usize = 240;
/// Memory of the boxes of all ticks.
const MOST_BYTES: usize = 256 << 20;
/// A file of boxes is set in motion for so many ticks.
const FILE_TICKS: usize = 32;
const SEED: u64 = 1;
/// A margin lasts for so many ticks of a usual box, but takes no more than this share of its edges: inflated boxes have
/// more pairs.
const MARGIN_TICKS: f32 = 8.0;
const MOST_MARGIN: f32 = 0.25;

#[derive(Debug, thiserror::Error)]
pub enum WorkloadError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("request {number}: the recording holds none that is valid: {source}")]
    Invalid { number: u64, source: Reject },
    #[error("there is nothing to measure: no frame and no edit of a scene")]
    Empty,
    #[error("index {index} of a scene is too large to be measured: at most {most}")]
    TooLarge { index: u64, most: u64 },
    #[error("writers of the shared scene set the same indices, {0:?} and {1:?}")]
    Writers(Range<u32>, Range<u32>),
}

/// What the program has to know after a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// All pairs.
    Pairs,
    /// The pairs that began and ended.
    Changes,
}

/// Ticks of a program.
#[derive(Debug)]
pub struct Workload {
    pub work: Work,
    /// Whether the program gets near pairs as it is.
    pub accepts_near: bool,
    /// What it asks that one way alone serves, and what was assumed: sentences.
    pub notes: Vec<String>,
}

#[derive(Debug)]
pub enum Work {
    /// Boxes alone, which every kind of session serves.
    Boxes(Boxes),
    /// Frames of spheres, of two sets or with filters.
    Frames(Vec<AskedFrame>),
    /// Edits of a scene that frames cannot serve, with what is asked after each.
    Edits(Vec<EditTick>),
}

/// An edit of a scene, and the queries and casts behind it, as they were recorded.
#[derive(Debug)]
pub struct EditTick {
    pub edit: Recorded,
    pub asked: Vec<Recorded>,
    /// Boxes of the scene after the edit.
    pub boxes: usize,
}

#[derive(Debug)]
pub struct Recorded {
    pub request: Request,
    pub pages: Vec<Page>,
}

/// Boxes from tick to tick, as many in each. What there is not is [`Aabb::EMPTY`].
#[derive(Clone, Debug)]
pub struct Boxes {
    states: Vec<Vec<Aabb>>,
    /// Indices whose box differs between a state and the next one.
    moved: Vec<Vec<u32>>,
    pub answer: Answer,
    /// Of a shared scene, the indices of each writer.
    pub writers: Vec<Range<u32>>,
}

impl Workload {
    pub fn of_recording(recording: &mut Recording<impl Read>) -> Result<Self, WorkloadError> {
        stream::workload(recording)
    }

    /// Boxes of which a share moves in each tick, always the same ones.
    pub fn of_boxes(boxes: Vec<Aabb>, moving: f64, answer: Answer) -> Result<Self, WorkloadError> {
        if boxes.is_empty() {
            return Err(WorkloadError::Empty);
        }
        let ticks = FILE_TICKS.min(MOST_BYTES / size_of_val(&boxes[..])).max(2);
        let mut random = Random::new(SEED);
        let moves: Vec<bool> = boxes.iter().map(|_| f64::from(random.unit()) < moving).collect();
        let mut scene = Scene::from_boxes(boxes.clone(), SEED);
        let mut states = vec![boxes];
        for _ in 1..ticks {
            scene.step();
            let of = |(i, b): (usize, &Aabb)| if moves[i] { *b } else { states[0][i] };
            states.push(scene.boxes().iter().enumerate().map(of).collect());
        }
        let percent = 100.0 * moving;
        let notes = vec![format!(
            "Assumed: {percent:.0} % of the boxes move, by 2 % of their size a tick (--moving)."
        )];
        let work = Work::Boxes(Boxes::new(states, answer, Vec::new()));
        Ok(Self { work, accepts_near: false, notes })
    }

    /// Boxes or spheres in the middle of it.
    pub fn boxes(&self) -> usize {
        match &self.work {
            Work::Boxes(boxes) => boxes.states[boxes.ticks() / 2]
                .iter()
                .filter(|b| b.class() == BoxClass::Valid)
                .count(),
            Work::Frames(frames) => frames[frames.len() / 2].objects.len(),
            Work::Edits(ticks) => ticks[ticks.len() / 2].boxes,
        }
    }

    pub fn ticks(&self) -> usize {
        match &self.work {
            Work::Boxes(boxes) => boxes.ticks(),
            Work::Frames(frames) => frames.len(),
            Work::Edits(ticks) => ticks.len(),
        }
    }

    /// Steps after which the same is done again.
    pub fn steps(&self) -> usize {
        match &self.work {
            Work::Boxes(boxes) => boxes.steps(),
            _ => self.ticks(),
        }
    }

    /// The share of boxes that move in a tick, where it is known.
    pub fn moving(&self) -> Option<f64> {
        let Work::Boxes(boxes) = &self.work else { return None };
        let moved: usize = boxes.moved.iter().map(Vec::len).sum();
        let all = boxes.moved.len() * self.boxes();
        (all > 0).then(|| moved as f64 / all as f64)
    }
}

impl Boxes {
    /// From states that may have fewer boxes than others: those in the middle, as many as may be.
    pub fn new(mut states: Vec<Vec<Aabb>>, answer: Answer, writers: Vec<Range<u32>>) -> Self {
        let n = states.iter().map(Vec::len).max().unwrap_or(0);
        let most = MOST_TICKS.min(MOST_BYTES / (n * size_of::<Aabb>()).max(1)).max(2);
        let cut = states.len().saturating_sub(most);
        states.drain(..cut / 2);
        states.truncate(most);
        for state in &mut states {
            state.resize(n, Aabb::EMPTY);
        }
        let bits = |b: &Aabb| [b.min, b.max].map(|corner| corner.map(f32::to_bits));
        let moved = states
            .windows(2)
            .map(|two| {
                (0..n as u32)
                    .filter(|i| {
                        let [before, after] =
                            [&two[0], &two[1]].map(|state| bits(&state[*i as usize]));
                        before != after
                    })
                    .collect()
            })
            .collect();
        Self { states, moved, answer, writers }
    }

    pub fn ticks(&self) -> usize {
        self.states.len()
    }

    fn steps(&self) -> usize {
        (2 * (self.ticks() - 1)).max(1)
    }

    /// The boxes of a step, and which of them differ from those of the step before. Steps go through the ticks to the
    /// last one and back again, so that no box leaps.
    pub fn step(&self, step: usize) -> (&[Aabb], &[u32]) {
        let last = self.ticks() - 1;
        if last == 0 {
            return (&self.states[0], &[]);
        }
        let at = step % self.steps();
        let (state, moved) = match at {
            0 => (0, 0),
            forth if forth <= last => (forth, forth - 1),
            back => (2 * last - back, 2 * last - back),
        };
        (&self.states[state], &self.moved[moved])
    }

    /// All boxes that there are, for bounds.
    pub fn all(&self) -> Vec<Aabb> {
        self.states.iter().flatten().filter(|b| b.class() == BoxClass::Valid).copied().collect()
    }

    /// A margin for boxes that move as these do; `None` where nothing moves, or by too much.
    pub fn margin(&self) -> Option<f32> {
        let mut steps = Vec::new();
        for (two, moved) in self.states.windows(2).zip(&self.moved) {
            steps.extend(moved.iter().filter_map(|i| distance(two, *i as usize)));
        }
        let edges = self.states[0].iter().filter(|b| b.class() == BoxClass::Valid);
        let edges = edges.map(|b| (0..3).map(|axis| b.max[axis] - b.min[axis]).sum::<f32>() / 3.0);
        let step = median(steps)?;
        let most = MOST_MARGIN * median(edges.collect())?;
        let margin = (MARGIN_TICKS * step).min(most);
        (margin > 2.0 * step).then(|| two_digits(margin))
    }

    /// The same work with so many boxes: those of a slab of the world, or several worlds side by side.
    pub fn resized(&self, n: usize) -> Option<Self> {
        let first = &self.states[0];
        let mut inside: Vec<u32> = (0..first.len() as u32)
            .filter(|i| self.states.iter().all(|state| is_finite(&state[*i as usize])))
            .collect();
        if inside.is_empty() {
            return None;
        }
        let of = |i: &u32| &first[*i as usize];
        let bound = |corner: fn(&Aabb) -> [f32; 3], outer: fn(f32, f32) -> f32, axis: usize| {
            inside.iter().map(|i| corner(of(i))[axis]).reduce(outer).unwrap_or(0.0)
        };
        let extent =
            |axis: usize| bound(|b| b.max, f32::max, axis) - bound(|b| b.min, f32::min, axis);
        let axis = (0..3).max_by(|a, b| extent(*a).total_cmp(&extent(*b)))?;
        // Two worlds do not touch.
        let period = 1.01 * extent(axis);
        inside.sort_by(|a, b| of(a).min[axis].total_cmp(&of(b).min[axis]));
        let most = (MOST_BYTES / 4 / (n * size_of::<Aabb>()).max(1)).max(2);
        let state = |state: &Vec<Aabb>| {
            (0..n)
                .map(|i| {
                    let mut b = state[inside[i % inside.len()] as usize];
                    let by = period * (i / inside.len()) as f32;
                    (b.min[axis], b.max[axis]) = (b.min[axis] + by, b.max[axis] + by);
                    b
                })
                .collect()
        };
        let states = self.states.iter().take(most).map(state).collect();
        Some(Self::new(states, self.answer, Vec::new()))
    }
}

fn is_finite(b: &Aabb) -> bool {
    b.class() == BoxClass::Valid && b.min.iter().chain(&b.max).all(|x| x.is_finite())
}

/// How far the box of an index is from where it was, on the axis on which that is most.
fn distance(two: &[Vec<Aabb>], index: usize) -> Option<f32> {
    let [before, after] = [&two[0][index], &two[1][index]];
    let far = |axis: usize| {
        let faces = [after.min[axis] - before.min[axis], after.max[axis] - before.max[axis]];
        faces[0].abs().max(faces[1].abs())
    };
    let far = (0..3).map(far).fold(0.0, f32::max);
    far.is_finite().then_some(far)
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    values.retain(|value| value.is_finite());
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}

/// A number with two digits that count, as a person would write it.
fn two_digits(value: f32) -> f32 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(n: usize) -> Vec<Aabb> {
        let at = |i: usize| [i as f32 * 2.0, 0.0, 0.0];
        (0..n).map(|i| Aabb::new(at(i), at(i).map(|x| x + 1.0))).collect()
    }

    #[test]
    fn a_file_moves_by_the_share_that_is_assumed_and_back_again() {
        let work = Workload::of_boxes(row(1_000), 0.25, Answer::Pairs).expect("boxes");
        let moving = work.moving().expect("boxes");
        assert!((0.2..0.3).contains(&moving), "{moving}");
        let Work::Boxes(boxes) = &work.work else { panic!("boxes") };
        // Applying what a step names to the boxes before gives the boxes of the step, there and back and again.
        let mut now = boxes.step(0).0.to_vec();
        for step in 1..5 * boxes.ticks() {
            let (state, moved) = boxes.step(step);
            for i in moved {
                now[*i as usize] = state[*i as usize];
            }
            assert_eq!(now, state, "{step}");
        }
        let still = Workload::of_boxes(row(10), 0.0, Answer::Pairs).expect("boxes");
        assert_eq!(still.moving(), Some(0.0));
        assert!(matches!(
            Workload::of_boxes(vec![], 0.1, Answer::Pairs),
            Err(WorkloadError::Empty)
        ));
    }

    #[test]
    fn a_margin_suits_the_motion_and_is_none_without() {
        let moved = |by: f32| {
            let states = (0..9).map(|tick| {
                let shift = |b: Aabb| b.moved([by * tick as f32, 0.0, 0.0]).0;
                row(20).into_iter().map(shift).collect()
            });
            Boxes::new(states.collect(), Answer::Pairs, vec![]).margin()
        };
        assert_eq!(moved(0.0), None);
        let margin = moved(0.01).expect("small steps");
        assert!((margin - 0.08).abs() < 1e-3, "{margin}");
        assert_eq!(moved(0.05), Some(0.25), "a quarter of an edge at most");
        assert_eq!(moved(3.0), None, "a box leaves it at once");
    }

    #[test]
    fn other_sizes_have_as_many_boxes_and_the_same_density() {
        let boxes = Boxes::new(vec![row(100), row(100)], Answer::Pairs, vec![]);
        for n in [1, 30, 100, 250] {
            let resized = boxes.resized(n).expect("finite boxes");
            let (state, _) = resized.step(0);
            assert_eq!(state.len(), n);
            let pairs = (0..n).flat_map(|b| (0..b).map(move |a| (a, b)));
            assert_eq!(pairs.filter(|(a, b)| state[*a].overlaps(&state[*b])).count(), 0, "{n}");
        }
        let none = Boxes::new(vec![vec![Aabb::EMPTY; 3]], Answer::Pairs, vec![]);
        assert!(none.resized(10).is_none());
    }
}
