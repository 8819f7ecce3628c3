//! A frame that several GPUs share, each a slab of it ([`share`](super::share)).
//!
//! Each counts its items; when all have, each knows where its own go, and writes them there. So the host
//! waits twice, which takes some 20 µs more than to wait once, and puts nothing together itself.

use std::time::{Duration, Instant};

use pairmask_core::BoxCount;
use pairmask_core::engine::{Census, CullError, CullInput, CullReport, EngineTimes, ReplyBuffer};
use pairmask_core::mask::MaskShape;
use pairmask_core::precision::BoxSlice;
use pairmask_shaders::constants::CONTROL_HEADER_WORDS;
use pairmask_shaders::layouts::{GridLayout, GridShare, GridSummary};

use super::plan::{self, Capacity, Sizes};
use super::share::{Borders, ShareWork};
use super::under_way::SharedWorkspace;
use super::workspace::{Phase, Placed, Wanted, census, reserve, wide};
use super::{ENGINE, Grid};
use crate::execute::frame_memory::end_process;
use crate::execute::gpu::error::GpuError;

/// Words of the control block's header that the host reads: `grid_params.wgsl` has the same.
const CURSOR: usize = 0;
const WORK: usize = 1;
const FIRST_ROW: usize = 2;
const END_ROW: usize = 3;

/// Where the share lies in the block of the layout, bytes.
const SHARE_AT: u64 = std::mem::offset_of!(GridLayout, share) as u64;

/// The workspaces of some grids are taken, or a reply of the usual size is too small: one grid does it.
const LEFT_TO_ONE: CullError =
    CullError::Unavailable { engine: ENGINE, why: "one GPU takes this frame" };

/// Finds the pairs of a frame with several grids, each on a GPU of its own, and moves the borders for the
/// next frame. The bytes are those of one grid.
///
/// # Errors
/// As a grid's [`cull`](pairmask_core::engine::Engine::cull). [`CullError::Unavailable`] where a grid has
/// other frames under way, and where more is found than in the frame before: one grid does it then.
pub fn cull_shared(
    grids: &mut [&mut Grid],
    input: &CullInput<'_>,
    borders: &mut Borders,
    reply: &mut dyn ReplyBuffer,
) -> Result<CullReport, CullError> {
    let start = Instant::now();
    let (boxes, encoding) = (input.boxes_alone(ENGINE)?, input.encoding);
    if borders.gpus() != grids.len() {
        *borders = Borders::new(grids.len());
    }
    let mut asked = Vec::with_capacity(grids.len());
    for grid in grids.iter() {
        asked.push(grid.asked(boxes.len(), encoding, reply)?);
    }
    let (Some((n, capacity)), Some(first)) = (asked.first().copied(), grids.first_mut()) else {
        return Err(LEFT_TO_ONE);
    };
    let layout = first.tools.chooser.choose(boxes);
    let shares = borders.shares(&layout, boxes);
    let mask = reserve(&first.tools, n, capacity, reply)?;
    let mut team = Team { members: Vec::with_capacity(grids.len()), n, capacity };
    team.begin(grids, boxes, &layout, &shares, mask)?;
    let ingested = start.elapsed();
    let counts = team.count(grids)?;
    let items = team.write(grids, &shares, &counts)?;
    let found = team.end(grids, &counts, items, reply)?;
    let executed = start.elapsed();
    borders.note(&found.works);
    for grid in grids {
        grid.tools.last_found.note(capacity.found, items, found.pairs);
    }
    let ns = |time: Duration| time.as_nanos() as u64;
    let times = EngineTimes {
        ingest_ns: ns(ingested),
        execute_ns: ns(executed.saturating_sub(ingested)),
        publish_ns: 0,
    };
    let shape = Sizes::of(n).shape(capacity.found, items);
    Ok(CullReport::new(n, shape, found.census, found.pairs, found.compared(), times))
}

/// What a GPU has counted of its share.
#[derive(Clone, Copy)]
struct Count {
    items: u64,
    first_row: u64,
    end_row: u64,
}

/// What all of them found.
#[derive(Default)]
struct FoundByAll {
    census: Census,
    pairs: u64,
    works: Vec<ShareWork>,
}

impl FoundByAll {
    fn compared(&self) -> u64 {
        self.works.iter().map(|work| work.compared).sum()
    }
}

/// Workspaces of grids that share a frame. Dropped, it waits for all of them: the boxes and the reply are
/// borrowed. A GPU that never ends its share ends the process, as with a frame of one grid.
struct Team {
    members: Vec<SharedWorkspace>,
    n: BoxCount,
    capacity: Capacity,
}

impl Team {
    /// Submits each share as far as its count.
    fn begin(
        &mut self,
        grids: &mut [&mut Grid],
        boxes: BoxSlice<'_>,
        layout: &GridLayout,
        shares: &[GridShare],
        mask: &[u32],
    ) -> Result<(), CullError> {
        for (grid, share) in grids.iter_mut().zip(shares) {
            let shared = grid.own_workspace.clone();
            {
                let mut workspace = shared.lock();
                if !workspace.is_free() {
                    return Err(LEFT_TO_ONE);
                }
                let layout = Some(GridLayout { share: *share, ..*layout });
                let (tools, n, capacity) = (&mut grid.tools, self.n, self.capacity);
                let objects = boxes.into();
                let (is_behind, marks) = (false, None);
                let wanted = Wanted { n, objects, mask, capacity, is_behind, layout, marks };
                let placed = workspace.place(tools, &wanted)?;
                let submitted = workspace.submit_phase(tools, &placed, Phase::Count);
                submitted.map_err(|error| grid.gpu.cull_error(ENGINE, &error))?;
                workspace.under_way = Some(placed);
            }
            self.members.push(shared);
        }
        Ok(())
    }

    /// Waits until each has counted its items.
    fn count(&self, grids: &mut [&mut Grid]) -> Result<Vec<Count>, CullError> {
        let mut counts = Vec::with_capacity(grids.len());
        for (grid, member) in grids.iter_mut().zip(&self.members) {
            let mut workspace = member.lock();
            let waited = workspace.wait(&mut grid.tools);
            waited.map_err(|error| grid.gpu.cull_error(ENGINE, &error))?;
            let placed = workspace.under_way.as_ref().ok_or(LEFT_TO_ONE)?;
            let mut header = [0u32; CONTROL_HEADER_WORDS as usize];
            placed.blocks.counted.read(0, &mut header);
            if plan::is_over_budget(header[WORK], 0) {
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            let (items, rows) = (u64::from(header[CURSOR]), [header[FIRST_ROW], header[END_ROW]]);
            if rows[0] > rows[1] || rows[1] > self.n.get() {
                return Err(fault(grid));
            }
            counts.push(Count { items, first_row: rows[0].into(), end_row: rows[1].into() });
        }
        Ok(counts)
    }

    /// Tells each where its items go, and has them written there. Returns how many all have.
    fn write(
        &self,
        grids: &mut [&mut Grid],
        shares: &[GridShare],
        counts: &[Count],
    ) -> Result<u64, CullError> {
        let items: u64 = counts.iter().map(|count| count.items).sum();
        if items > self.capacity.items {
            for grid in grids {
                grid.tools.last_found.note(self.capacity.found, items, items);
            }
            return Err(LEFT_TO_ONE);
        }
        let mut first_item = 0;
        for ((grid, member), (share, count)) in
            grids.iter_mut().zip(&self.members).zip(shares.iter().zip(counts))
        {
            let mut workspace = member.lock();
            let placed = workspace.under_way.take().ok_or(LEFT_TO_ONE)?;
            // Items fit the reply, which is one binding of 32-bit words.
            let (first, all) = (first_item as u32, items as u32);
            let told = GridShare { first_item: first, all_items: all, ..*share };
            placed.blocks.layout.write(SHARE_AT, &[told]);
            let submitted = workspace.submit_phase(&mut grid.tools, &placed, Phase::Write);
            workspace.under_way = Some(placed);
            submitted.map_err(|error| grid.gpu.cull_error(ENGINE, &error))?;
            first_item += count.items;
        }
        Ok(items)
    }

    /// Waits until all is written.
    fn end(
        &self,
        grids: &mut [&mut Grid],
        counts: &[Count],
        items: u64,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FoundByAll, CullError> {
        let (mut found, mut staged) = (FoundByAll::default(), Vec::new());
        let mut first_item = 0;
        for ((grid, member), count) in grids.iter_mut().zip(&self.members).zip(counts) {
            let mut workspace = member.lock();
            let waited = workspace.wait(&mut grid.tools);
            waited.map_err(|error| grid.gpu.cull_error(ENGINE, &error))?;
            let placed = workspace.under_way.take().ok_or(LEFT_TO_ONE)?;
            workspace.unclean = false;
            let mut summary = [GridSummary::default()];
            placed.blocks.summary.read(0, &mut summary);
            let [summary] = summary;
            if plan::is_over_budget(summary.work, summary.giant_work) {
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            let (compared, pairs) = (wide(summary.compared), wide(summary.pairs));
            if wide(summary.items) != count.items || compared > self.n.pair_count() {
                return Err(fault(grid));
            }
            if found.works.is_empty() {
                // All of them have read all boxes.
                let plane = Sizes::of(self.n).plane();
                found.census = census(&summary, &placed.blocks.invalid, plane);
            }
            found.pairs += pairs;
            let rows = count.end_row - count.first_row;
            found.works.push(ShareWork { rows, compared, items: count.items });
            if !placed.mask.is_reply {
                staged.push((placed, *count, first_item));
            }
            first_item += count.items;
        }
        // The reply is asked for its memory again: no GPU writes there any more.
        for (placed, count, first_item) in staged {
            self.copy_down(&placed, count, first_item, items, reply)?;
        }
        Ok(found)
    }

    /// Copies what a share wrote to memory of its GPU's own into the reply.
    fn copy_down(
        &self,
        placed: &Placed,
        count: Count,
        first_item: u64,
        items: u64,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(), CullError> {
        let sizes = Sizes::of(self.n);
        let room = sizes.reply_words(self.capacity);
        let reserved = &mut reply.reserve(room)?[..room as usize];
        let mut copy = |start: u64, words: u64| {
            let to = &mut reserved[start as usize..(start + words) as usize];
            placed.mask.part.block.read(placed.mask.part.offset + 4 * start, to);
        };
        match sizes.shape(self.capacity.found, items) {
            MaskShape::Sparse { rows, blocks, bits, .. } => {
                copy(count.first_row, count.end_row - count.first_row);
                for section in [rows, blocks, bits] {
                    copy(section.start + first_item, count.items);
                }
            }
            MaskShape::List { pairs } => copy(pairs.start + 2 * first_item, 2 * count.items),
            // The grid writes no others.
            _ => {}
        }
        Ok(())
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        let mut all_ended = true;
        for member in &self.members {
            all_ended &= member.lock().give_up();
        }
        if !all_ended {
            end_process();
        }
    }
}

/// No scene has as many: the device does not do what the stages say.
fn fault(grid: &Grid) -> CullError {
    grid.gpu.cull_error(ENGINE, &GpuError::Driver(ash::vk::Result::ERROR_UNKNOWN))
}
