//! The answer to a frame.

use pairmask::filters::World;
use pairmask::{FrameInfo, PairMask};
use pyo3::prelude::*;
use pyo3::types::PyIterator;

use crate::guarded::Guarded;
use crate::memory::Array;

/// All pairs of a mask.
pub fn pairs_of(mask: &PairMask) -> Vec<[u32; 2]> {
    // Room as the engine counts them, unless another process has made that number up.
    let n = u64::from(mask.n().get());
    let most = n * n.saturating_sub(1) / 2;
    let mut pairs = Vec::new();
    let _ = pairs.try_reserve(mask.count().min(most) as usize);
    mask.for_each_slice(|some| pairs.extend_from_slice(some));
    pairs
}

/// The overlapping pairs of a frame. It holds one of the session's three slots for frames until it is
/// released or dropped. Arrays that it gave stay.
#[pyclass(frozen, name = "PairMask", module = "pairmask")]
pub struct PyPairMask {
    mask: Guarded<PairMask>,
    /// Boxes or spheres of the frame.
    #[pyo3(get)]
    n: u32,
    /// Number of pairs.
    #[pyo3(get)]
    count: u64,
    /// How the mask is written.
    #[pyo3(get)]
    encoding: String,
    info: FrameInfo,
}

impl PyPairMask {
    pub fn new(mask: PairMask) -> Self {
        Self {
            n: mask.n().get(),
            count: mask.count(),
            encoding: mask.encoding().to_string(),
            info: *mask.info(),
            mask: Guarded::new(mask, "the mask was released"),
        }
    }
}

#[pymethods]
impl PyPairMask {
    /// The pairs (count, 2) as rows (a, b), a < b.
    fn pairs(&self, py: Python<'_>) -> PyResult<Array> {
        self.mask.with_detached(py, |mask| Array::read_only(pairs_of(mask)))
    }

    fn __len__(&self) -> usize {
        self.count as usize
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.pairs(py)?.into_pyobject(py)?.try_iter()
    }

    /// Facts about the frame beside its pairs.
    #[getter]
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let FrameInfo { census, skipped, .. } = &self.info;
        let first = census.first_invalid.iter().copied().take(census.invalid as usize);
        imported!(py, "pairmask._answers", "FrameInfo")?.call1((
            self.info.served_by.as_str(),
            self.info.engine.to_string(),
            self.info.threads,
            self.info.form.to_string(),
            census.invalid,
            census.empty,
            first.collect::<Vec<u32>>(),
            skipped.is_repeat(),
            skipped.pairs,
            self.info.mask_bytes,
            self.info.box_bytes,
            self.info.times.total_ns,
        ))
    }

    /// Whether two boxes or spheres overlap.
    fn __contains__(&self, py: Python<'_>, pair: (u32, u32)) -> PyResult<bool> {
        self.mask.with(py, |mask| mask.contains(pair.0, pair.1))
    }

    /// The worlds whose pairs stand together in the list, rising.
    fn worlds(&self, py: Python<'_>) -> PyResult<Vec<i32>> {
        self.mask.with(py, |mask| mask.worlds().iter().map(|range| range.world.0).collect())
    }

    /// The pairs (m, 2) of a world, or `None` where `worlds` does not have it.
    fn pairs_of_world(&self, py: Python<'_>, world: i32) -> PyResult<Option<Array>> {
        // The list may lie in another process's memory: what names no box is left out.
        let is_pair = |[a, b]: &[u32; 2]| a < b && *b < self.n;
        self.mask.with(py, |mask| {
            let pairs = mask.pairs_of_world(World(world))?;
            Some(Array::read_only(pairs.iter().copied().filter(is_pair).collect()))
        })
    }

    /// Gives the frame's memory back now. Arrays that were made of it stay.
    fn release(&self, py: Python<'_>) -> PyResult<()> {
        self.mask.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.release(py)
    }

    fn __repr__(&self) -> String {
        format!("PairMask({} boxes, {} pairs, {})", self.n, self.count, self.encoding)
    }
}
