//! The hits of many questions: dealt out to threads, and put together again.

use std::sync::atomic::{self, AtomicU64};

use super::near::SphereProbe;
use super::probe::Probe;
use super::ray::RayProbe;
use super::search::{Candidate, Common, Place, Search, TOGETHER};
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
    type Probe: Probe;

    /// What it is searched by; `None` where it hits nothing.
    fn probe(&self, place: &Place<'_>) -> Option<Self::Probe>;
}

impl Question for Ray {
    type Probe = RayProbe;

    fn probe(&self, place: &Place<'_>) -> Option<RayProbe> {
        match place {
            Place::Candidates(_) => RayProbe::without_bounds(self),
            Place::Tree(_) | Place::Boxes(_) => RayProbe::new(self),
        }
    }
}

impl Question for Sphere {
    type Probe = SphereProbe;

    fn probe(&self, place: &Place<'_>) -> Option<SphereProbe> {
        let reach = match place {
            Place::Tree(tree) => tree.reach(),
            Place::Boxes(_) | Place::Candidates(_) => 0.0,
        };
        SphereProbe::new(self, reach)
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

/// What a task has found so far. Not the task's, whose neighbours lie in the same lines of the caches.
struct Gathered<'a> {
    all: Vec<Hit>,
    looked_at: u64,
    counted: usize,
    pace: Pace,
    is_out_of_memory: bool,
    /// Hits of all tasks.
    count: &'a AtomicU64,
    limits: Limits<'a>,
}

impl Gathered<'_> {
    /// Adds what a question has found among the boxes that it looked at. Whether to go on.
    fn add(
        &mut self,
        query: u32,
        found: &[Candidate],
        looked_at: u64,
        index_of: impl Fn(u32) -> u32,
    ) -> bool {
        let Self { all, limits, .. } = self;
        self.looked_at += looked_at;
        if all.try_reserve(found.len()).is_err() {
            self.is_out_of_memory = true;
            return false;
        }
        all.extend(found.iter().map(|hit| Hit {
            query,
            index: index_of(hit.index),
            distance: hit.reported,
        }));
        if limits.cancel.look_after(LEAST_TESTS + looked_at, &mut self.pace) {
            return false;
        }
        if all.len() - self.counted < COUNTED_TOGETHER {
            return true;
        }
        self.count_found();
        !self.is_full()
    }

    /// Lets the other tasks know how many hits there are.
    fn count_found(&mut self) {
        let more = self.all.len() - std::mem::replace(&mut self.counted, self.all.len());
        // Relaxed: a number that ends a search, and that nothing is read by.
        self.count.fetch_add(more as u64, atomic::Ordering::Relaxed);
    }

    fn is_full(&self) -> bool {
        self.count.load(atomic::Ordering::Relaxed) > self.limits.most_hits
    }
}

impl<Q: Question> Task<'_, Q> {
    /// Finds the hits in one place, of some questions at a time. Whether to go on with others.
    fn run_in(&self, common: Common<'_>, gathered: &mut Gathered<'_>) -> bool {
        let mut searches = Vec::with_capacity(TOGETHER);
        let mut memory = Vec::new();
        let together = common.together();
        for (first, some) in (self.first..).step_by(together).zip(self.questions.chunks(together)) {
            for (query, question) in (first..).zip(some) {
                // A copy: another process may write questions while they are read.
                let question = *question;
                if let Some(probe) = question.probe(&common.place) {
                    let kept = memory.pop().unwrap_or_default();
                    searches.push(Search::new(common, query, probe, kept));
                }
            }
            Search::run(&mut searches);
            for search in searches.drain(..) {
                if !gathered.add(search.query, &search.found, search.looked_at, |index| index) {
                    return false;
                }
                memory.push(search.found);
            }
        }
        true
    }

    /// Finds the hits among what somebody found for each question. Whether to go on with others.
    fn run_among(
        &self,
        candidates_of: &CandidatesOf<'_>,
        common: Common<'_>,
        gathered: &mut Gathered<'_>,
    ) -> bool {
        let (mut candidates, mut kept) = (Vec::new(), Vec::new());
        for (query, question) in (self.first..).zip(self.questions) {
            let question = *question;
            candidates.clear();
            candidates_of(query, &mut candidates);
            // So that those as near as each other come by their index.
            candidates.sort_unstable_by_key(|(index, _)| *index);
            let index_of = |at: u32| candidates.get(at as usize).map_or(at, |(index, _)| *index);
            let admits = |query, at| (common.admits)(query, index_of(at));
            let common =
                Common { place: Place::Candidates(&candidates), admits: &admits, ..common };
            let Some(probe) = question.probe(&common.place) else { continue };
            let mut search = Search::new(common, query, probe, kept);
            Search::run(std::slice::from_mut(&mut search));
            kept = search.found;
            if !gathered.add(query, &kept, search.looked_at, index_of) {
                return false;
            }
        }
        true
    }
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
    let count = AtomicU64::new(0);
    let is_full = || count.load(atomic::Ordering::Relaxed) > limits.most_hits;
    let common = |place| Common {
        place,
        hits,
        room: usize::try_from(limits.most_hits).unwrap_or(usize::MAX).saturating_add(1),
        isa: AvailableIsa::best(),
        admits,
    };
    for_each_in_parts(&mut tasks, parts, |task| {
        if is_full() {
            return;
        }
        let mut gathered = Gathered {
            all: Vec::new(),
            looked_at: 0,
            counted: 0,
            pace: Pace::default(),
            is_out_of_memory: false,
            count: &count,
            limits,
        };
        match among {
            Among::Tree(tree) => task.run_in(common(Place::Tree(tree)), &mut gathered),
            Among::Boxes(boxes) => task.run_in(common(Place::Boxes(boxes)), &mut gathered),
            Among::Candidates(of) => {
                task.run_among(of, common(Place::Candidates(&[])), &mut gathered)
            }
        };
        gathered.count_found();
        task.found = gathered.all;
        task.looked_at = gathered.looked_at;
        task.is_out_of_memory = gathered.is_out_of_memory;
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
