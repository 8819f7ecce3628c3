//! The answer to a frame.

use pairmask::filters::World;
use pairmask::{FrameInfo, PairMask};
use pyo3::prelude::*;
use pyo3::types::PyIterator;

use crate::guarded::Guarded;
use crate::memory::Memory;

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

/// The overlapping pairs of a frame. It holds one of the session's three places for frames until it is
/// released or dropped. Arrays that it gave stay.
#[pyclass(frozen, name = "PairMask", module = "pairmask")]
pub struct PyPairMask {
    mask: Guarded<PairMask>,
    n: u32,
    count: u64,
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
    /// The pairs as rows (a, b), a < b.
    fn pairs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pairs = self.mask.with_detached(py, |mask| pairs_of(mask))?;
        Memory::of_rows(pairs).into_array(py)
    }

    /// Boxes or spheres of the frame.
    #[getter]
    fn n(&self) -> u32 {
        self.n
    }

    /// Number of pairs.
    #[getter]
    fn count(&self) -> u64 {
        self.count
    }

    fn __len__(&self) -> usize {
        self.count as usize
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.pairs(py)?.try_iter()
    }

    /// How the mask is written.
    #[getter]
    fn encoding(&self) -> &str {
        &self.encoding
    }

    /// Facts about the frame beside its pairs.
    #[getter]
    fn info(&self) -> PyFrameInfo {
        PyFrameInfo { info: self.info }
    }

    /// Whether two boxes or spheres overlap.
    fn contains(&self, py: Python<'_>, a: u32, b: u32) -> PyResult<bool> {
        self.mask.with(py, |mask| mask.contains(a, b))
    }

    fn __contains__(&self, py: Python<'_>, pair: (u32, u32)) -> PyResult<bool> {
        self.contains(py, pair.0, pair.1)
    }

    /// The worlds whose pairs stand together in the list, rising.
    fn worlds(&self, py: Python<'_>) -> PyResult<Vec<i32>> {
        self.mask.with(py, |mask| mask.worlds().iter().map(|range| range.world.0).collect())
    }

    /// The pairs of a world, or `None` where `worlds` does not have it.
    fn pairs_of_world<'py>(
        &self,
        py: Python<'py>,
        world: i32,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        // The list may lie in another process's memory: what names no box is left out.
        let n = self.n;
        let is_pair = |[a, b]: &[u32; 2]| a < b && *b < n;
        let pairs = self.mask.with(py, |mask| {
            let pairs = mask.pairs_of_world(World(world))?;
            Some(pairs.iter().copied().filter(is_pair).collect::<Vec<_>>())
        })?;
        pairs.map(|pairs| Memory::of_rows(pairs).into_array(py)).transpose()
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

/// Facts about an answered frame beside its pairs.
#[pyclass(frozen, name = "FrameInfo", module = "pairmask")]
pub struct PyFrameInfo {
    info: FrameInfo,
}

#[pymethods]
impl PyFrameInfo {
    /// What answered: `daemon` or `in-process`.
    #[getter]
    fn served_by(&self) -> &'static str {
        self.info.served_by.as_str()
    }

    /// The engine.
    #[getter]
    fn engine(&self) -> String {
        self.info.engine.to_string()
    }

    /// Threads that the engine could use.
    #[getter]
    fn threads(&self) -> usize {
        self.info.threads
    }

    /// What the objects were: the form of the boxes, or spheres.
    #[getter]
    fn form(&self) -> String {
        self.info.form.to_string()
    }

    /// Boxes with a NaN.
    #[getter]
    fn invalid(&self) -> u32 {
        self.info.census.invalid
    }

    /// Boxes with `min > max` on some axis.
    #[getter]
    fn empty(&self) -> u32 {
        self.info.census.empty
    }

    /// The lowest indices of invalid boxes, eight at most.
    #[getter]
    fn first_invalid(&self) -> Vec<u32> {
        let census = &self.info.census;
        census.first_invalid.iter().copied().take(census.invalid as usize).collect()
    }

    /// Whether the frame was equal to the last one, so that no engine looked at it.
    #[getter]
    fn is_repeat(&self) -> bool {
        self.info.skipped.is_repeat()
    }

    /// Pairs that were never compared.
    #[getter]
    fn skipped_pairs(&self) -> u64 {
        self.info.skipped.pairs
    }

    /// Bytes of the mask.
    #[getter]
    fn mask_bytes(&self) -> u64 {
        self.info.mask_bytes
    }

    /// Bytes of the boxes or spheres.
    #[getter]
    fn box_bytes(&self) -> u64 {
        self.info.box_bytes
    }

    /// From the request in hand to the response ready to be sent, nanoseconds.
    #[getter]
    fn total_ns(&self) -> u64 {
        self.info.times.total_ns
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.info)
    }
}
