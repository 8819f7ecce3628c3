//! `cpu-grid`: a uniform grid with levels; each box looks at the cells around its home.
//!
//! The papers' grid (Avril et al. 2012, §4) lists a box in every cell that it touches. Here each
//! box has one home cell, by its min corner, in the finest level whose cells are at least as long
//! as it is; boxes are sorted by level, z, y, x of the cell, so that a cell's neighbours are a few
//! runs of positions. That neighbours are enough is proved in `axis.rs` for the very arithmetic that
//! is computed. Pairs across levels are looked for from the larger box: it iterates over the cells of the
//! finer levels that it covers. Work is O(n + pairs) for boxes that the sample finds a good layout for; giants,
//! infinite boxes and those far from all others go to levels of their own. Boxes that cells do not part are handed over
//! to the tree: before anything is sorted where the sample shows them, and else when more columns were tested than the
//! tree would take.

mod axis;
mod bucket;
mod cell_strips;
mod cost;
mod explain;
mod far;
mod fetch;
mod fold;
mod homes;
mod layout;
mod level;
mod neighbours;
mod rows;
mod sample;
mod sort;
mod tile;

pub use self::explain::{GridCell, GridView, explain};
pub use self::far::near_bounds;
pub use self::fold::{FOLDED_LEAST, folded};
use self::layout::Layout;
pub(crate) use self::layout::{SizeClass, cell_counts, size_classes};
use self::rows::{CellSearch, Scene};
pub(crate) use self::sample::{Density, Sample};
use self::sort::SortedBoxes;
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::engine::gather::Gather;
use crate::engine::ordered::{Arrangement, Ordered};
use crate::engine::strips::{OrderedBoxes, StripTask};
use crate::engine::{AvailableIsa, Census, CpuEngine, CullError, EngineDescriptor, EngineName};

/// Strips a box, as the layout expects them, from which `cpu-tree` takes less time.
const STRIPS_MOST: f32 = 32.0;

/// `cpu-grid` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor::of_cpu(
    "cpu-grid",
    3,
    true,
    CpuEngine { make: |isa| Box::new(Grid::on(isa)), terms: cost::TERMS },
);

/// The engine `cpu-grid`.
type Grid = Ordered<Cells>;

/// Boxes by cell.
#[derive(Default)]
pub(super) struct Cells {
    layout: Layout,
    sorted: SortedBoxes,
}

impl Arrangement for Cells {
    const NAME: EngineName = EngineName::CpuGrid;
    const PARALLEL_BOXES: usize = 2_048;
    const TASK_ROWS: usize = 1_024;
    const HANDS_OVER: bool = true;
    const HAS_CELLS: bool = true;

    type Own = CellSearch;

    fn arrange(
        &mut self,
        boxes: &[Aabb],
        threads: usize,
        may_hand_over: bool,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError> {
        self.layout.choose(boxes);
        let is_crowded =
            |layout: &Layout| layout.cost > STRIPS_MOST && layout.sure_cost() > STRIPS_MOST;
        if may_hand_over && is_crowded(&self.layout) {
            return Err(CullError::TooCrowded { engine: Self::NAME });
        }
        let Layout { levels, cell_count, .. } = &self.layout;
        self.sorted.sort(boxes, levels, *cell_count, threads, isa, cancel)
    }

    fn boxes(&self) -> &OrderedBoxes {
        &self.sorted.boxes
    }

    fn search(&self, task: &mut StripTask<CellSearch>, _valid: u32, gather: &Gather<'_>) {
        task.search(Scene { sorted: &self.sorted, levels: &self.layout.levels, gather });
    }

    fn allocated_bytes(&self) -> usize {
        self.sorted.allocated_bytes()
    }
}
