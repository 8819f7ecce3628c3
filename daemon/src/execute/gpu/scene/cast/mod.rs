//! Casts into a scene in video memory. The GPU looks for the boxes of many rays or spheres, by bounds that err outward; the
//! host decides those that it names, exactly. Few rays or spheres, and those that the GPU leaves, are the cores', which
//! have a copy of the boxes (GPU.md, "Scenes").
//!
//! ```text
//! plan   sizes of the tree in video memory
//! tree   the tree, and searches in it
//! copy   the boxes in host memory
//! ```

mod copy;
mod plan;
mod tree;

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::cancel::Cancel;
use pairmask_core::cast::{Among, Deciders, Hit, Hits, Limits, Ray, Shapes};
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_core::scene::states::STILL;
use pairmask_core::scene::{Cast, Edit, QueryError, QueryFilterData};
use pairmask_core::sphere::Sphere;

use self::copy::{CastCopy, Record, colliding, read_records};
pub(super) use self::tree::DeviceTree;
use self::tree::{Found, MOST_CLOSEST};
use super::ENGINE;
use crate::execute::gpu::{GpuError, GpuScene};

/// Fewest rays or spheres that the GPU looks for: it takes some 150 µs for any of them, in which the cores do as many.
const FEWEST: usize = 512;
/// Most of a submission: memory for what they find is taken ahead.
const TOGETHER: usize = 1 << 18;
/// Edits without a cast after which the tree in video memory is dropped: some seconds of a game.
const UNUSED_EDITS: u32 = 256;
/// So many casts are the cores' after one of which the GPU left them much.
const RESTS: u32 = 32;
/// What is much: one ray or sphere in so many.
const LEFT_SHARE: usize = 8;

/// What a scene keeps for casts, beside the trees in video memory.
#[derive(Debug, Default)]
pub(super) struct Casts {
    copy: CastCopy,
    /// Edits since the GPU was asked.
    edits: u32,
    /// Casts to come that are the cores'.
    rests: u32,
    /// Rays or spheres of the last cast that were the cores'.
    left: usize,
}

impl Casts {
    pub fn allocated_bytes(&self) -> usize {
        self.copy.allocated_bytes()
    }

    /// Whether it is the GPU's turn to look.
    const fn take_turn(&mut self) -> bool {
        let rests = self.rests > 0;
        self.rests = self.rests.saturating_sub(1);
        !rests
    }
}

/// Whether a cast is one for the GPU: it knows no filters, which say which boxes are the closest ones.
pub fn is_for_gpu(cast: &Cast<'_>) -> bool {
    let is_unfiltered = cast.filter_data == QueryFilterData::None;
    let is_known = match cast.hits {
        Hits::All => true,
        Hits::Any => is_unfiltered,
        Hits::Closest(most) => is_unfiltered && (1..=MOST_CLOSEST).contains(&most),
    };
    is_known && cast.shapes.len() >= FEWEST
}

/// The error of a cast with more hits than may be.
fn exceeded(cast: &Cast<'_>) -> CullError {
    Limits { most_hits: cast.most_hits, threads: 1, cancel: &Cancel::never() }.exceeded()
}

impl GpuScene {
    /// How many rays or spheres of the last cast the cores have looked for.
    pub const fn left_to_cores(&self) -> usize {
        self.casts.left
    }

    /// Has casts follow an edit that was applied.
    pub(super) fn note_edit_for_casts(&mut self, edit: Edit<'_>) {
        self.casts.copy.note_edit(edit, &self.roster.states);
        self.casts.edits = self.casts.edits.saturating_add(1);
        for replica in &mut self.replicas.0 {
            if self.casts.edits > UNUSED_EDITS {
                replica.casts = None;
            } else if let Some(tree) = &mut replica.casts {
                tree.note_edit();
            }
        }
    }

    /// As [`Scene::cast`](pairmask_core::scene::Scene::cast).
    ///
    /// # Errors
    /// [`QueryError`]. After [`CullError::DeviceLost`] the scene is to be dropped.
    pub fn cast(&mut self, cast: &Cast<'_>, found: &mut Vec<Hit>) -> Result<u64, QueryError> {
        cast.filter_data.check(cast.shapes.len())?;
        self.casts.left = 0;
        if !is_for_gpu(cast) {
            return Ok(self.cast_by_cores(cast, None, found)?);
        }
        found.clear();
        let looked_at = self.cast_in_parts(cast, found).map_err(|error| {
            found.clear();
            match error {
                // Of a part, which may find no more than the parts before it have left.
                CullError::Reserve(ReserveError::TooLarge { .. }) => exceeded(cast),
                other => other,
            }
        })?;
        Ok(looked_at)
    }

    fn cast_in_parts(&mut self, cast: &Cast<'_>, found: &mut Vec<Hit>) -> Result<u64, CullError> {
        let (mut looked_at, mut more) = (0, Vec::new());
        for first in (0..cast.shapes.len()).step_by(TOGETHER) {
            self.check_wanted()?;
            let mut part = cast.part(first..(first + TOGETHER).min(cast.shapes.len()));
            part.most_hits -= found.len() as u64;
            looked_at += loop {
                match self.cast_part(&part, &mut more) {
                    // Another GPU has all that this one had.
                    Err(CullError::DeviceLost { .. }) if self.replicas.leave_first() => {}
                    answered => break answered?,
                }
            };
            let needed_bytes = size_of_val(&more[..]) as u64;
            let no_memory = |_| CullError::from(ReserveError::OutOfMemory { needed_bytes });
            found.try_reserve(more.len()).map_err(no_memory)?;
            found.extend(more.iter().map(|hit| Hit { query: hit.query + first as u32, ..*hit }));
        }
        Ok(looked_at)
    }

    /// Has the GPU look, and the cores where it finds too many, has no memory, or rests.
    fn cast_part(&mut self, cast: &Cast<'_>, found: &mut Vec<Hit>) -> Result<u64, CullError> {
        if !self.casts.take_turn() {
            return self.cast_by_cores(cast, None, found);
        }
        self.casts.edits = 0;
        if let Some((searched, _deciders)) = self.search_casts(cast)? {
            return self.decide(cast, &searched, found);
        }
        self.casts.rests = RESTS;
        self.cast_by_cores(cast, None, found)
    }

    /// What the first GPU finds. `None` where that is too much, or it has no memory.
    fn search_casts(&mut self, cast: &Cast<'_>) -> Result<Option<(Found, Deciders)>, CullError> {
        let (threads, slots) = (self.threads(), self.index_end());
        let tree = &self.replicas.first().casts;
        let boxes = if tree.as_ref().is_none_or(DeviceTree::needs_order) {
            // May leave the first GPU.
            Some(self.boxes()?)
        } else {
            None
        };
        let replica = self.replicas.first();
        let tools = Arc::clone(&replica.tools);
        let Some(now) = replica.memory.records_now() else { return Ok(None) };
        // Where it fails, it is dropped.
        let tree = replica.casts.take();
        let mut tree = tree.unwrap_or_else(|| DeviceTree::new(&tools));
        let ordered = boxes.map(|boxes| tree.put_in_order(&tools, &boxes, threads)).transpose();
        let deciders = Deciders::call(cast.shapes.len(), cast.hits, threads);
        let searched =
            ordered.and_then(|_| tree.search(&tools, now, slots, cast.shapes, cast.hits, threads));
        match searched {
            Ok(found) => {
                replica.casts = Some(tree);
                Ok(found.map(|found| (found, deciders)))
            }
            Err(GpuError::OutOfMemory { .. }) => Ok(None),
            Err(error) => Err(tools.gpu().cull_error(ENGINE, &error)),
        }
    }

    /// Decides what the GPU has found, and has the cores look for what it left.
    fn decide(
        &mut self,
        cast: &Cast<'_>,
        searched: &Found,
        found: &mut Vec<Hit>,
    ) -> Result<u64, CullError> {
        let (threads, cancel) = (self.threads(), &self.cancel);
        let of = |query: u32, to: &mut Vec<(u32, Aabb)>| searched.candidates(query, to);
        let (among, states) = (Among::Candidates(&of), &self.roster.states);
        let is_still = |index| states.has(index, STILL);
        cast.among(among, &states.filters, is_still, threads, cancel, found)?;
        if searched.is_wrong() {
            let gpu = Arc::clone(self.replicas.first().tools.gpu());
            return Err(gpu.cull_error(ENGINE, &GpuError::Lost));
        }
        if !searched.has_given_up() {
            return Ok(searched.looked_at);
        }
        let left = searched.given_up();
        if left.len() * LEFT_SHARE > cast.shapes.len() {
            self.casts.rests = RESTS;
        }
        let mut others = Vec::new();
        let looked_at = self.cast_by_cores(cast, Some(&left), &mut others)?;
        found.append(&mut others);
        if found.len() as u64 > cast.most_hits {
            return Err(exceeded(cast));
        }
        // Those of one query stay as they are.
        found.sort_by_key(|hit| hit.query);
        Ok(searched.looked_at + looked_at)
    }

    /// Casts shapes, or some of them by their numbers, into the copy of the boxes.
    fn cast_by_cores(
        &mut self,
        cast: &Cast<'_>,
        some: Option<&[u32]>,
        found: &mut Vec<Hit>,
    ) -> Result<u64, CullError> {
        if !self.casts.copy.is_current() {
            let records = self.records()?;
            self.casts.copy.take(&records)?;
        }
        let (most_hits, threads, cancel) = (cast.most_hits, self.threads(), &self.cancel);
        let limits = Limits { most_hits, threads, cancel };
        let states = &self.roster.states;
        let admits = cast.admits(&states.filters, |index| states.has(index, STILL));
        let count = some.map_or(cast.shapes.len(), <[u32]>::len);
        self.casts.left += count;
        let among = self.casts.copy.among(count, limits);
        let Some(some) = some else {
            return among.cast(cast.shapes, cast.hits, &admits, limits, found);
        };
        let admits = |at: u32, index: u32| admits(some[at as usize], index);
        let looked_at = match cast.shapes {
            Shapes::Rays(rays) => {
                let rays: Vec<Ray> = some.iter().map(|query| rays[*query as usize]).collect();
                among.cast(Shapes::Rays(&rays), cast.hits, &admits, limits, found)
            }
            Shapes::Spheres(of) => {
                let spheres: Vec<Sphere> = some.iter().map(|query| of[*query as usize]).collect();
                among.cast(Shapes::Spheres(&spheres), cast.hits, &admits, limits, found)
            }
        }?;
        for hit in found {
            hit.query = some[hit.query as usize];
        }
        Ok(looked_at)
    }

    /// All boxes as they collide, by index.
    fn boxes(&mut self) -> Result<Vec<Aabb>, CullError> {
        if let Some(boxes) = self.casts.copy.boxes() {
            return Ok(boxes.to_vec());
        }
        Ok(self.records()?.iter().map(colliding).collect())
    }

    /// All records, of the first GPU that has them.
    fn records(&mut self) -> Result<Vec<Record>, CullError> {
        let slots = self.roster.states.index_end();
        loop {
            let replica = self.replicas.first();
            let read = read_records(replica, slots);
            match read.map_err(|error| replica.tools.gpu().cull_error(ENGINE, &error)) {
                Err(CullError::DeviceLost { .. }) if self.replicas.leave_first() => {}
                read => return read,
            }
        }
    }
}
