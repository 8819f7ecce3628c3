//! Answers of scenes, as arrays that stay when the scene goes on.

use std::ops::Range;

use pairmask::{EndReason, Ended, SceneAnswer};
use pyo3::prelude::*;
use pyo3::types::PyRange;

use crate::memory::Memory;

/// An answer as it is read from the library, before there are arrays of it.
pub struct Read {
    pub begun: Vec<[u32; 2]>,
    pub ended: Vec<Ended>,
    pub pairs: Vec<[u32; 2]>,
    pub is_resync: bool,
    pub pair_count: Option<u64>,
    pub served_by: &'static str,
    pub engine: String,
    pub skipped_pairs: u64,
    pub tick: Option<u64>,
    pub late: Vec<Range<u32>>,
}

impl Read {
    pub fn of(answer: &SceneAnswer<'_>) -> Self {
        Self {
            begun: answer.begun().to_vec(),
            ended: answer.ended().to_vec(),
            pairs: answer.pairs().to_vec(),
            is_resync: answer.is_resync(),
            pair_count: answer.pair_count(),
            served_by: answer.served_by().as_str(),
            engine: answer.engine().to_string(),
            skipped_pairs: answer.skipped().pairs(),
            tick: answer.tick(),
            late: answer.late().to_vec(),
        }
    }
}

/// Numbers of `EndReason` in Python.
const fn number(reason: EndReason) -> u8 {
    match reason {
        EndReason::Removed => 0,
        EndReason::Filtered => 1,
        EndReason::Separated => 2,
        // None yet.
        _ => u8::MAX,
    }
}

/// What an edit tells. All lists are sorted.
#[pyclass(frozen, get_all, name = "SceneAnswer", module = "pairmask")]
pub struct PySceneAnswer {
    /// Pairs that began, for `changes`.
    begun: Py<PyAny>,
    /// Pairs that ended, for `changes`.
    ended: Py<PyAny>,
    /// Why they ended: numbers of `EndReason`.
    ended_reasons: Py<PyAny>,
    /// Pairs of now, for `all`, `moved` and a resync.
    pairs: Py<PyAny>,
    /// Whether changes were asked for and `pairs` holds all pairs instead.
    is_resync: bool,
    /// Pairs of the whole scene, if the answer knows.
    pair_count: Option<u64>,
    /// What answered.
    served_by: &'static str,
    /// The engine that answered.
    engine: String,
    /// Pairs that were not tested.
    skipped_pairs: u64,
    /// The tick of a shared scene.
    tick: Option<u64>,
    /// Leases of writers of a shared scene that were late.
    late: Vec<Py<PyRange>>,
}

impl PySceneAnswer {
    pub fn new(py: Python<'_>, read: Read) -> PyResult<Self> {
        let reasons = read.ended.iter().map(|ended| number(ended.reason)).collect();
        let ended = read.ended.iter().map(|ended| ended.pair).collect();
        let rows = |rows: Vec<[u32; 2]>| Memory::of_rows(rows).into_array(py).map(Bound::unbind);
        let late: PyResult<Vec<_>> =
            read.late.iter().map(|range| python_range(py, range)).collect();
        Ok(Self {
            begun: rows(read.begun)?,
            ended: rows(ended)?,
            ended_reasons: Memory::of_numbers::<u8>(reasons).into_array(py)?.unbind(),
            pairs: rows(read.pairs)?,
            is_resync: read.is_resync,
            pair_count: read.pair_count,
            served_by: read.served_by,
            engine: read.engine,
            skipped_pairs: read.skipped_pairs,
            tick: read.tick,
            late: late?,
        })
    }
}

/// A range of indices as Python's `range`.
pub fn python_range(py: Python<'_>, range: &Range<u32>) -> PyResult<Py<PyRange>> {
    PyRange::new(py, range.start as isize, range.end as isize).map(Bound::unbind)
}
