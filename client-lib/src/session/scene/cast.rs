//! Casts into a scene: which boxes rays hit, and which are nearest to points.

use std::time::{Duration, Instant};

use pairmask_core::cancel::Cancel;
use pairmask_core::cast::{Among, HIT_BYTES, Hit, Hits, Limits, Ray, Shapes};
use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::pacing::{Answered, Estimate};
use pairmask_core::scene::{Cast, Margined, QueryFilterData, Scene as CoreScene};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_wire::{CastReply, CastRequest, ReplyFields, RequestHeader};

use super::backend::Scene;
use super::question::{Asked, Question};
use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::link::Exchange;
use crate::session::pairs::ServedBy;

/// Most hits of an answer of this process: 1 GiB, as a daemon's by default.
const MOST_HITS: u64 = (1 << 30) / HIT_BYTES as u64;

impl Scene {
    /// Casts rays, and reports the boxes that each hits, [all or the closest](Hits), in the order of their distance;
    /// [`pairmask::cast`](crate::cast) defines what is hit. A segment is a ray with an [end](Ray::up_to), and a box that
    /// moves along it a ray with [half extents](Ray::with_half_extents).
    ///
    /// It asks the scene as [`query`](Self::query) does. Of boxes with margins, the boxes as they were set count; of other
    /// members of a shared scene, those that they have sent.
    ///
    /// ```
    /// use pairmask::cast::{Hits, Ray};
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x, -1.0, -1.0], [x + 1.0, 1.0, 1.0]);
    /// scene.edit().set(7, at(4.0)).set(9, at(2.0)).commit(Report::Nothing)?;
    ///
    /// let rays = [Ray::new([0.0; 3], [1.0, 0.0, 0.0]), Ray::new([0.0; 3], [0.0, 1.0, 0.0])];
    /// let found = scene.cast(&rays, Hits::Closest(1))?;
    /// assert_eq!((found.of_query(0)[0].index, found.of_query(0)[0].distance), (9, 2.0));
    /// assert!(!found.is_hit(1));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error`].
    pub fn cast(&mut self, rays: &[Ray], hits: Hits) -> Result<HitAnswer, Error> {
        self.cast_filtered(rays, hits, QueryFilterData::None)
    }

    /// Reports the boxes that spheres touch, the nearest to each center first: with [`Hits::Closest`] and an infinite
    /// radius, so many nearest boxes of a point.
    ///
    /// ```
    /// use pairmask::cast::Hits;
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session, Sphere};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x, -1.0, -1.0], [x + 1.0, 1.0, 1.0]);
    /// scene.edit().set(7, at(4.0)).set(9, at(2.0)).commit(Report::Nothing)?;
    ///
    /// let found = scene.nearest(&[Sphere::new([0.0; 3], f32::INFINITY)], Hits::Closest(2))?;
    /// let found: Vec<_> = found.hits().iter().map(|hit| (hit.index, hit.distance)).collect();
    /// assert_eq!(found, [(9, 2.0), (7, 4.0)]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error`].
    pub fn nearest(&mut self, spheres: &[Sphere], hits: Hits) -> Result<HitAnswer, Error> {
        self.cast_filtered(spheres, hits, QueryFilterData::None)
    }

    /// Casts rays or spheres that find only what may meet boxes with the given filter data: one
    /// [`FilterData`](crate::filters::FilterData) for all, or a slice with one for each. The scene's
    /// [filters](crate::filters) decide, except for the include and the exclude list.
    ///
    /// # Errors
    /// [`Error`].
    pub fn cast_filtered<'t>(
        &mut self,
        shapes: impl Into<Shapes<'t>>,
        hits: Hits,
        filter_data: impl Into<QueryFilterData<'t>>,
    ) -> Result<HitAnswer, Error> {
        let (shapes, filter_data) = (shapes.into(), filter_data.into());
        filter_data.check(shapes.len())?;
        let cast = Cast { shapes, hits, filter_data, most_hits: MOST_HITS };
        match self.margins.take() {
            None => self.backend.ask(&self.core, &cast),
            Some(margins) => {
                let answer = self.cast_with_margins(&cast, &margins);
                self.margins = Some(margins);
                answer
            }
        }
    }

    /// Asks the inflated boxes, for twice as many until those that are left out are farther than what counts.
    fn cast_with_margins(
        &mut self,
        cast: &Cast<'_>,
        margins: &Margined,
    ) -> Result<HitAnswer, Error> {
        let wanted = match cast.hits {
            Hits::All => u32::MAX,
            Hits::Closest(most) => most,
            Hits::Any => 1,
        };
        let mut most = wanted.saturating_mul(2).saturating_add(8);
        loop {
            let hits = if cast.hits == Hits::All { Hits::All } else { Hits::Closest(most) };
            let mut answer = self.backend.ask(&self.core, &Cast { hits, ..*cast })?;
            let mut exact = Vec::new();
            let mut is_done = true;
            for query in 0..answer.queries {
                let inflated = answer.of_query(query);
                let start = exact.len();
                add_exact(cast.shapes, inflated, margins, &mut exact)?;
                exact.truncate(exact.len().min(start.saturating_add(wanted as usize)));
                // Distances are reported to a step of f32.
                let (last, farthest) = (exact[start..].last(), inflated.last());
                let is_within = || {
                    let [last, farthest] = [last, farthest].map(|hit| hit.map(|hit| hit.distance));
                    exact.len() - start == wanted as usize
                        && last
                            .zip(farthest)
                            .is_some_and(|(last, farthest)| last.next_up() < farthest.next_down())
                };
                is_done &= (inflated.len() as u64) < u64::from(most) || is_within();
            }
            if is_done || most == u32::MAX {
                if cast.hits == Hits::Any {
                    for hit in &mut exact {
                        *hit = Hit { query: hit.query, index: Hit::ANY, distance: 0.0 };
                    }
                }
                answer.hits = exact;
                return Ok(answer);
            }
            most = most.saturating_mul(2);
        }
    }
}

/// Adds the hits of a query by the boxes as they were set, given those of inflated ones. Those of other members are not
/// here: they are in between by their reported distances.
fn add_exact(
    shapes: Shapes<'_>,
    inflated: &[Hit],
    margins: &Margined,
    exact: &mut Vec<Hit>,
) -> Result<(), Error> {
    let Some(first) = inflated.first() else { return Ok(()) };
    let mut own: Vec<u32> = inflated.iter().map(|hit| hit.index).collect();
    own.retain(|index| margins.now().get(*index).is_some());
    own.sort_unstable();
    let boxes: Vec<_> = own.iter().filter_map(|index| margins.now().get(*index)).collect();
    let at = first.query as usize;
    let shape = match shapes {
        Shapes::Rays(rays) => Shapes::Rays(&rays[at..=at]),
        Shapes::Spheres(spheres) => Shapes::Spheres(&spheres[at..=at]),
    };
    let limits = Limits { most_hits: boxes.len() as u64, threads: 1, cancel: &Cancel::never() };
    let mut found = Vec::new();
    Among::Boxes(&boxes).cast(shape, Hits::All, &|_, _| true, limits, &mut found)?;
    let own_hit = |hit: &Hit| Hit { query: first.query, index: own[hit.index as usize], ..*hit };
    let mut own_hits = found.iter().map(own_hit).peekable();
    let of_others = |hit: &&Hit| margins.now().get(hit.index).is_none();
    for other in inflated.iter().filter(of_others) {
        let is_first = |hit: &Hit| {
            let by_distance = hit.distance.total_cmp(&other.distance);
            by_distance.then(hit.index.cmp(&other.index)).is_lt()
        };
        while let Some(hit) = own_hits.next_if(is_first) {
            exact.push(hit);
        }
        exact.push(*other);
    }
    exact.extend(own_hits);
    Ok(())
}

impl Question for Cast<'_> {
    type Answer = HitAnswer;

    fn is_empty(&self) -> bool {
        self.shapes.is_empty()
    }

    fn ask(&self, asked: Asked<'_>, estimate: &mut Estimate) -> Result<HitAnswer, Error> {
        let Self { shapes, hits, filter_data, .. } = self;
        let Asked { core, link, scene, revision, threads, index_end, .. } = asked;
        let too_many = Error::TooManyBoxes { n: shapes.len(), limit: u64::from(u32::MAX) };
        let request = CastRequest::new(scene, revision, *shapes, *hits, filter_data);
        let Some(mut request) = request else { return Err(too_many) };
        request.threads = threads;
        let mut shared = core.loan(link, request.payload_bytes())?;
        if !request.write(*shapes, filter_data, shared.loan.pages_mut()) {
            return Err(too_many);
        }
        let fields = ReplyFields {
            client_token: link.token(),
            frame: core.next_frame(),
            box_count: BoxCount::new(request.count()),
        };
        let header = RequestHeader::cast_scene(fields.client_token, fields.frame, &request);
        let exchange = Exchange::begin(shared, &header)?;
        let answer = core.end(exchange, estimate.expect(request.count()))?;
        let pages = answer.memory.pages();
        let reply = CastReply::parse(&answer.header, &fields, size_of_val(pages) as u64)?;
        let hits = reply.read(pages, &request, index_end)?;
        estimate.note(Answered {
            n: request.count(),
            round_trip: answer.round_trip,
            took: Duration::from_nanos(reply.times.total_ns),
            threads: reply.threads,
        });
        let CastReply { engine, times, .. } = reply;
        Ok(HitAnswer { hits, queries: request.count(), served_by: ServedBy::Daemon, engine, times })
    }

    fn ask_here(&self, _: &Core, scene: &mut CoreScene) -> Result<HitAnswer, Error> {
        let (begin, mut hits) = (Instant::now(), Vec::new());
        scene.cast(self, &mut hits)?;
        let execute_ns = begin.elapsed().as_nanos() as u64;
        Ok(HitAnswer {
            hits,
            queries: self.shapes.len() as u32,
            served_by: ServedBy::InProcess,
            engine: EngineName::CpuTree.into(),
            times: StageTimes { execute_ns, total_ns: execute_ns, ..StageTimes::default() },
        })
    }
}

/// What rays have hit, or spheres touched: by query, by distance, and then by index.
///
/// Regardless of what a daemon writes, every query is one that there was, and every index one that there may be.
#[derive(Clone, Debug)]
pub struct HitAnswer {
    hits: Vec<Hit>,
    queries: u32,
    served_by: ServedBy,
    engine: EngineId,
    times: StageTimes,
}

impl HitAnswer {
    /// All hits.
    pub fn hits(&self) -> &[Hit] {
        &self.hits
    }

    /// The hits of one ray or sphere, the closest first.
    pub fn of_query(&self, query: u32) -> &[Hit] {
        let start = self.hits.partition_point(|hit| hit.query < query);
        let count = self.hits[start..].partition_point(|hit| hit.query == query);
        &self.hits[start..][..count]
    }

    /// Whether a ray or a sphere has hit anything: of [`Hits::Any`] all that there is to know.
    pub fn is_hit(&self, query: u32) -> bool {
        !self.of_query(query).is_empty()
    }

    /// How many rays or spheres there were.
    pub const fn queries(&self) -> u32 {
        self.queries
    }

    /// What answered.
    pub const fn served_by(&self) -> ServedBy {
        self.served_by
    }

    /// The engine that answered. It may be one of a later daemon that this build does not know.
    pub const fn engine(&self) -> EngineId {
        self.engine
    }

    /// How long the parts of the answer took where it was made.
    pub const fn times(&self) -> StageTimes {
        self.times
    }
}
