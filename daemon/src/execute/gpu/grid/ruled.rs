//! Frames with rules: boxes of several worlds, and pairs that may not meet (GPU.md, "Frames with rules"). Avril et al.
//! 2014 have no filters; that worlds are part of the cell key is how simulators of many small scenes go about it.

use std::sync::Arc;

use pairmask_core::Encoding;
use pairmask_core::dispatch::{Marks, WorldRange};
use pairmask_core::engine::{CullError, CullReport, ReplyBuffer};
use pairmask_core::precision::BoxSlice;
use pairmask_shaders::Found;

use super::layout::WORLD_BOXES_LEAST;
use crate::execute::frame_memory::Borrowed;
use crate::execute::gpu::{Block, Gpu, GpuError, Grid, Growing, Home, Part, Sizes};
use crate::locked;

/// Rules whose marks are kept in video memory: those of a few sessions.
const CACHED_RULES: usize = 4;
/// A world may have so many times the boxes of the average one: cells are shared out evenly, so those of
/// a larger world would be crowded.
const MOST_UNEVEN: usize = 8;

/// Whether `n` boxes of such marks get a grid: cells are shared out evenly among their worlds.
pub fn takes_worlds(marks: &Marks, n: usize) -> bool {
    let worlds = marks.worlds().len();
    let is_even = marks.largest_world() * worlds <= MOST_UNEVEN * n;
    worlds < 2 || is_even && n / worlds >= WORLD_BOXES_LEAST as usize
}

pub(super) struct RuleBlocks {
    pub(super) of: Arc<Marks>,
    pub(super) marks: Part,
    /// Which rows are the first of a world.
    row_worlds: Part,
    /// Where the items of each world begin.
    world_firsts: Part,
}

impl RuleBlocks {
    pub(super) fn named(&self) -> [(&'static str, &Part); 3] {
        let Self { marks, row_worlds, world_firsts, .. } = self;
        [("rules", marks), ("row_worlds", row_worlds), ("world_firsts", world_firsts)]
    }

    /// Reads where the items of each world begin. Nothing where all boxes are of one.
    pub(super) fn read_world_firsts(&self, firsts: &mut Vec<u32>) {
        firsts.clear();
        firsts.resize(self.of.worlds().len(), 0);
        self.world_firsts.block.read(self.world_firsts.offset, firsts);
    }
}

pub(super) struct Ruled {
    /// Marks in video memory, those used last first.
    kept: Vec<(Arc<Marks>, Arc<Block>)>,
    row_worlds: Growing,
    world_firsts: Growing,
    home: Home,
}

impl Ruled {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            kept: Vec::new(),
            row_worlds: Growing::new(Home::Video),
            world_firsts: Growing::new(Home::Host),
            home: Home::written(gpu),
        }
    }

    /// The blocks of a frame. `replaced` is set if recorded frames have other ones.
    pub(super) fn blocks(
        &mut self,
        gpu: &Arc<Gpu>,
        marks: &Arc<Marks>,
        sizes: &Sizes,
        replaced: &mut bool,
    ) -> Result<RuleBlocks, GpuError> {
        let marks_bytes = 4 * marks.words().len() as u64;
        let at = self.kept.iter().position(|(of, _)| Arc::ptr_eq(of, marks));
        let kept = if let Some(at) = at {
            self.kept.remove(at)
        } else {
            // Those that no session has any more are not asked for again.
            self.kept.retain(|(of, _)| Arc::strong_count(of) > 1);
            self.kept.truncate(CACHED_RULES - 1);
            let block = Block::new(gpu, self.home, marks_bytes)?;
            block.write(0, marks.words());
            (Arc::clone(marks), block)
        };
        let of = Arc::clone(marks);
        let marks = Part::of(&kept.1, 0, marks_bytes);
        self.kept.insert(0, kept);
        let row_worlds = self.row_worlds.part(gpu, 8 * u64::from(sizes.plane()), replaced)?;
        // A binding is not empty, where all boxes are of one world either.
        let bytes = 4 * of.worlds().len().max(1) as u64;
        let world_firsts = self.world_firsts.part(gpu, bytes, replaced)?;
        Ok(RuleBlocks { of, marks, row_worlds, world_firsts })
    }
}

impl Grid {
    /// Finds the pairs that rules let meet; those of boxes that are both on a list are left to the host, if
    /// [`Marks::has_lists`]. Where boxes are of several worlds, a list is ordered by world, and `ranges` says
    /// where the pairs of each are; [`CullError::TooCrowded`] where worlds have too few boxes for a grid.
    pub fn cull_ruled(
        &mut self,
        boxes: BoxSlice<'_>,
        marks: &Arc<Marks>,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
        ranges: &mut Vec<WorldRange>,
    ) -> Result<CullReport, CullError> {
        ranges.clear();
        let memory = Borrowed { objects: boxes.into(), reply };
        let workspace = self.own_workspace.clone();
        let frame = self.begin_in(workspace.clone(), memory, encoding, Some(marks));
        let report = self.end(frame.map_err(|(error, _)| error)?).0?;
        if Found::of(encoding) == Some(Found::Pairs) {
            let mut firsts = locked(&workspace).world_firsts.clone();
            firsts.push(report.pair_count as u32);
            if !firsts.is_sorted() {
                // No list is so: the device does not do what the stages say.
                let fault = GpuError::Driver(ash::vk::Result::ERROR_UNKNOWN);
                return Err(self.tools.gpu.cull_error(super::ENGINE, &fault));
            }
            let ends = firsts.iter().skip(1).map(|end| *end as usize);
            let pairs = firsts.iter().zip(ends).map(|(first, end)| *first as usize..end);
            let worlds = marks.worlds().iter().zip(pairs);
            ranges.extend(worlds.map(|(world, pairs)| WorldRange::new(*world, pairs)));
        }
        Ok(report)
    }
}
