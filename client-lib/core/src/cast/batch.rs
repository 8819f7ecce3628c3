//! The hits of many questions: dealt out to threads, and put together again.

use std::sync::atomic::{self, AtomicU64};

use super::near::SphereProbe;
use super::ray::{RayProbe, is_extreme};
use super::search::{Place, Search};
use super::tree::BoxTree;
use super::{HIT_BYTES, Hit, Hits, Ray};
use crate::aabb::Aabb;
use crate::cancel::{Cancel, Pace};
use crate::engine::{AvailableIsa, CullError, ReserveError};
use crate::sphere::Sphere;
use crate::team::{self, for_each_in_parts, part_count};

/// Questions of a task, at least: some 100 µs.
const TASK_QUERIES: usize = 64;
/// What a question takes beside the boxes that are looked at, in tests of boxes.
const LEAST_TESTS: u64 = 512;
/// Hits that a task finds before it tells the others, which wait for each other there; beyond those that may be, each has
/// memory for as many.
const COUNTED_TOGETHER: usize = 1_024;

/// What bounds a cast, beside the boxes.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Most hits of all questions together.
    pub most_hits: u64,
    /// Threads at most, of the pool of the caller.
    pub threads: usize,
    /// Whether the hits are still wanted.
    pub cancel: &'a Cancel,
}

impl Limits<'_> {
    /// The error where there are more hits than may be.
    pub fn exceeded(&self) -> CullError {
        let bytes = |hits: u64| hits.saturating_mul(HIT_BYTES as u64);
        let at_least_bytes = bytes(self.most_hits.saturating_add(1));
        ReserveError::TooLarge { at_least_bytes, limit_bytes: bytes(self.most_hits) }.into()
    }
}

/// What is cast.
#[derive(Clone, Copy, Debug)]
pub enum Shapes<'a> {
    /// Rays.
    Rays(&'a [Ray]),
    /// Spheres.
    Spheres(&'a [Sphere]),
}

impl<'a> From<&'a [Ray]> for Shapes<'a> {
    fn from(rays: &'a [Ray]) -> Self {
        Self::Rays(rays)
    }
}

impl<'a> From<&'a [Sphere]> for Shapes<'a> {
    fn from(spheres: &'a [Sphere]) -> Self {
        Self::Spheres(spheres)
    }
}

impl Shapes<'_> {
    /// How many there are.
    pub const fn len(&self) -> usize {
        match self {
            Self::Rays(rays) => rays.len(),
            Self::Spheres(spheres) => spheres.len(),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Adds the candidates of a question, given its number: boxes and their indices, each once.
pub type CandidatesOf<'a> = dyn Fn(u32, &mut Vec<(u32, Aabb)>) + Sync + 'a;

/// Where hits are searched for.
#[derive(Clone, Copy)]
pub enum Among<'a> {
    /// In a tree.
    Tree(&'a BoxTree),
    /// Among boxes that are looked at one after the other: index i is box i.
    Boxes(&'a [Aabb]),
    /// Among those that somebody found for each question.
    Candidates(&'a CandidatesOf<'a>),
}

impl Among<'_> {
    /// Finds the boxes that rays hit or spheres touch, of those that a caller admits, given the number of the ray or
    /// sphere and the index of the box. Hits come by number, by distance, and by index; what `found` held is dropped.
    /// Returns how many boxes were looked at.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmask_core::cancel::Cancel;
    /// use pairmask_core::cast::{Among, BoxTree, Hits, Limits, Ray, Shapes};
    ///
    /// let boxes = [3.0, 1.0, 2.0].map(|x| Aabb::new([x, -1.0, -1.0], [x + 0.5, 1.0, 1.0]));
    /// let tree = BoxTree::of(&boxes, 1);
    /// let along_x = Ray::new([0.0; 3], [1.0, 0.0, 0.0]);
    /// let limits = Limits { most_hits: 1_000, threads: 1, cancel: &Cancel::never() };
    /// let mut found = Vec::new();
    /// Among::Tree(&tree).cast(Shapes::Rays(&[along_x]), Hits::Closest(2), &|_, _| true, limits, &mut found)?;
    /// let found: Vec<_> = found.iter().map(|hit| (hit.index, hit.distance)).collect();
    /// assert_eq!(found, [(1, 1.0), (2, 2.0)]);
    /// # Ok::<(), pairmask_core::engine::CullError>(())
    /// ```
    ///
    /// # Errors
    /// [`CullError::Reserve`] where there are more hits than may be, or there is no memory for them;
    /// [`CullError::Cancelled`].
    pub fn cast(
        self,
        shapes: Shapes<'_>,
        hits: Hits,
        admits: &(impl Fn(u32, u32) -> bool + Sync),
        limits: Limits<'_>,
        found: &mut Vec<Hit>,
    ) -> Result<u64, CullError> {
        match shapes {
            Shapes::Rays(rays) => find(self, rays, hits, admits, limits, found),
            Shapes::Spheres(spheres) => find(self, spheres, hits, admits, limits, found),
        }
    }
}

/// A ray or a sphere.
trait Question: Copy + Sync {
    fn ask(&self, search: &mut Search<'_>, admits: &dyn Fn(u32) -> bool);
}

impl Question for Ray {
    fn ask(&self, search: &mut Search<'_>, admits: &dyn Fn(u32) -> bool) {
        match is_extreme(self) {
            None => {}
            Some(_) if matches!(search.place, Place::Candidates(_)) => {
                search.run(&RayProbe::<f32>::without_bounds(self), admits);
            }
            Some(false) => search.run(&RayProbe::<f32>::new(self), admits),
            Some(true) => search.run(&RayProbe::<f64>::new(self), admits),
        }
    }
}

impl Question for Sphere {
    fn ask(&self, search: &mut Search<'_>, admits: &dyn Fn(u32) -> bool) {
        let reach = match search.place {
            Place::Tree(tree) => tree.reach(),
            Place::Boxes(_) | Place::Candidates(_) => 0.0,
        };
        if let Some(probe) = SphereProbe::new(self, reach) {
            search.run(&probe, admits);
        }
    }
}

/// Some questions of a task.
struct Task<'a, Q> {
    first: u32,
    questions: &'a [Q],
    found: Vec<Hit>,
    looked_at: u64,
    is_out_of_memory: bool,
}

/// A thread decides a candidate in so long, ns.
const DECIDE_NS: f64 = 50.0;
/// Candidates of a question of which all hits are asked for: so many are few.
const SOME_HITS: u32 = 8;

/// Threads of so many that the candidates of questions are worth.
fn deciding_threads(questions: usize, hits: Hits, most: usize) -> usize {
    let candidates = match hits {
        Hits::Any => 1,
        Hits::Closest(closest) => closest,
        Hits::All => SOME_HITS,
    };
    let one_ns = DECIDE_NS * f64::from(candidates.saturating_add(1)) * questions as f64;
    team::threads_for(one_ns, Some(most))
}

/// Threads that wait for candidates to decide, until this is dropped or for some 100 µs.
#[must_use = "the threads leave when this is dropped"]
pub struct Deciders {
    _team: team::Frame,
}

impl Deciders {
    /// Calls threads, so many at most, for the candidates of so many questions, which somebody is about to find: to wake
    /// takes a thread as long as a GPU looks for them.
    pub fn call(questions: usize, hits: Hits, threads: usize) -> Self {
        Self { _team: team::enter(deciding_threads(questions, hits, threads)) }
    }
}

/// Finds the hits of many questions.
fn find<Q: Question>(
    among: Among<'_>,
    questions: &[Q],
    hits: Hits,
    admits: &(impl Fn(u32, u32) -> bool + Sync),
    limits: Limits<'_>,
    found: &mut Vec<Hit>,
) -> Result<u64, CullError> {
    found.clear();
    let threads = match among {
        Among::Candidates(_) => deciding_threads(questions.len(), hits, limits.threads),
        Among::Tree(_) | Among::Boxes(_) => limits.threads,
    };
    let _team = team::enter(threads);
    let parts = part_count(questions.len(), TASK_QUERIES, threads);
    let step = questions.len().div_ceil(parts).max(1);
    let some = (0u32..).step_by(step).zip(questions.chunks(step));
    let mut tasks: Vec<Task<'_, Q>> = some
        .map(|(first, questions)| Task {
            first,
            questions,
            found: Vec::new(),
            looked_at: 0,
            is_out_of_memory: false,
        })
        .collect();
    let (isa, count) = (AvailableIsa::best(), AtomicU64::new(0));
    let is_full = || count.load(atomic::Ordering::Relaxed) > limits.most_hits;
    for_each_in_parts(&mut tasks, parts, |task| {
        if is_full() {
            return;
        }
        let room = usize::try_from(limits.most_hits).unwrap_or(usize::MAX).saturating_add(1);
        let (mut kept, mut candidates) = (Vec::new(), Vec::new());
        // Not the task's, whose neighbours lie in the same lines of the caches.
        let (mut all, mut looked_at, mut counted, mut pace) = (Vec::new(), 0, 0, Pace::default());
        for (query, question) in (task.first..).zip(task.questions) {
            // A copy: another process may write questions while they are read.
            let question = *question;
            candidates.clear();
            let place = match among {
                Among::Tree(tree) => Place::Tree(tree),
                Among::Boxes(boxes) => Place::Boxes(boxes),
                Among::Candidates(of) => {
                    of(query, &mut candidates);
                    // So that those as near as each other come by their index.
                    candidates.sort_unstable_by_key(|(index, _)| *index);
                    Place::Candidates(&candidates)
                }
            };
            let index_of = |at: u32| candidates.get(at as usize).map_or(at, |(index, _)| *index);
            let mut search = Search { place, hits, room, isa, found: kept, looked_at: 0 };
            search.found.clear();
            question.ask(&mut search, &|at| admits(query, index_of(at)));
            looked_at += search.looked_at;
            let tests = LEAST_TESTS + search.looked_at;
            kept = search.found;
            if all.try_reserve(kept.len()).is_err() {
                task.is_out_of_memory = true;
                break;
            }
            all.extend(kept.iter().map(|hit| Hit {
                query,
                index: index_of(hit.index),
                distance: hit.reported,
            }));
            if limits.cancel.look_after(tests, &mut pace) {
                return;
            }
            if all.len() - counted >= COUNTED_TOGETHER {
                // Relaxed: a number that ends a search, and that nothing is read by.
                count.fetch_add((all.len() - counted) as u64, atomic::Ordering::Relaxed);
                counted = all.len();
                if is_full() {
                    return;
                }
            }
        }
        count.fetch_add((all.len() - counted) as u64, atomic::Ordering::Relaxed);
        (task.found, task.looked_at) = (all, looked_at);
    });
    if limits.cancel.is_cancelled() {
        return Err(CullError::Cancelled);
    }
    if is_full() {
        return Err(limits.exceeded());
    }
    let all: usize = tasks.iter().map(|task| task.found.len()).sum();
    let needed_bytes = (all * HIT_BYTES) as u64;
    let is_out_of_memory = tasks.iter().any(|task| task.is_out_of_memory);
    if is_out_of_memory || found.try_reserve(all).is_err() {
        return Err(ReserveError::OutOfMemory { needed_bytes }.into());
    }
    for task in &tasks {
        found.extend_from_slice(&task.found);
    }
    Ok(tasks.iter().map(|task| task.looked_at).sum())
}
