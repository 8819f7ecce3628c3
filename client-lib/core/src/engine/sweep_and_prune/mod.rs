//! `cpu-sap`: sweep and prune on several cores.
//!
//! Avril, Gouranton and Arnaldi 2009 (§5.1) and 2014 (§4): boxes shared out among threads, each
//! with storage of its own, merged without locks. The papers compare all pairs; here boxes are
//! sorted along the axis on which fewest start within another, beginning with the order of the last
//! frame (Cohen et al. 1995), and a row is compared with the window after it, 16 columns a step.
//! Giants cost their own window and nothing more, which makes this the engine for scenes of few boxes,
//! and of those that lie along a line or in few places.

mod axis;
mod copies;
mod cost;
mod order;
mod sweep;

use self::copies::Copies;
use self::order::SweepOrder;
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::engine::gather::Gather;
use crate::engine::ordered::{Arrangement, Ordered};
use crate::engine::strips::{OrderedBoxes, StripTask};
use crate::engine::{AvailableIsa, Census, CpuEngine, CullError, EngineDescriptor, EngineName};

/// `cpu-sap` in the list of engines.
pub(super) const DESCRIPTOR: EngineDescriptor = EngineDescriptor::of_cpu(
    "cpu-sap",
    2,
    true,
    CpuEngine { make: |isa| Box::new(SweepAndPrune::on(isa)), terms: cost::TERMS },
);

/// The engine `cpu-sap`.
type SweepAndPrune = Ordered<Sweep>;

/// Boxes along the sweep axis.
#[derive(Default)]
pub(super) struct Sweep {
    copies: Copies,
    order: SweepOrder,
    boxes: OrderedBoxes,
    axis: usize,
}

impl Arrangement for Sweep {
    const NAME: EngineName = EngineName::CpuSap;
    const PARALLEL_BOXES: usize = 1_024;
    const TASK_ROWS: usize = 512;
    const HANDS_OVER: bool = true;
    const HAS_CELLS: bool = false;

    type Own = ();

    fn arrange(
        &mut self,
        boxes: &[Aabb],
        _threads: usize,
        _may_hand_over: bool,
        isa: AvailableIsa,
        cancel: &Cancel,
    ) -> Result<Census, CullError> {
        self.axis = axis::sweep_axis(boxes, isa);
        let census = self.copies.make(boxes, self.axis, isa, cancel);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        self.order.sort(self.copies.mins(), cancel)?;
        let n = boxes.len();
        self.boxes.resize(n);
        let (keys, order) = self.boxes.parts_mut();
        for (slot, index) in order.iter_mut().zip(self.order.indices()) {
            *slot = index;
        }
        self.copies.gather(order, keys, isa, cancel);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        // What overlaps nothing stands last.
        self.boxes.empty_from(census.valid_of(n));
        Ok(census)
    }

    fn boxes(&self) -> &OrderedBoxes {
        &self.boxes
    }

    fn search(&self, task: &mut StripTask, valid: u32, gather: &Gather<'_>) {
        sweep::search(task, &self.boxes, self.axis, valid, gather);
    }

    fn allocated_bytes(&self) -> usize {
        self.copies.allocated_bytes() + self.order.allocated_bytes() + self.boxes.allocated_bytes()
    }
}
