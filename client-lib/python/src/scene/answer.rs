//! Answers of scenes, as arrays that stay when the scene goes on.

use std::ops::Range;

use pairmask::{EndReason, SceneAnswer};
use pyo3::prelude::*;
use pyo3::types::PyRange;

use crate::memory::Array;

/// Indices from one to before another: Python's `range`.
pub struct Indices(pub Range<u32>);

impl<'py> IntoPyObject<'py> for Indices {
    type Target = PyRange;
    type Output = Bound<'py, PyRange>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        PyRange::new(py, self.0.start as isize, self.0.end as isize)
    }
}

/// An answer as it is read from the library: the fields of `SceneAnswer` in Python.
#[derive(IntoPyObject)]
pub struct Read {
    begun: Array,
    ended: Array,
    ended_reasons: Array,
    pairs: Array,
    is_resync: bool,
    pair_count: Option<u64>,
    served_by: &'static str,
    engine: String,
    skipped_pairs: u64,
    tick: Option<u64>,
    late: Vec<Indices>,
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

impl Read {
    pub fn of(answer: &SceneAnswer<'_>) -> Self {
        let ended = answer.ended().collect::<Vec<_>>();
        let reasons = ended.iter().map(|ended| [number(ended.reason)]).collect();
        Self {
            begun: Array::read_only(answer.begun().to_vec()),
            ended: Array::read_only(ended.iter().map(|ended| ended.pair).collect()),
            ended_reasons: Array::read_only(reasons),
            pairs: Array::read_only(answer.pairs().to_vec()),
            is_resync: answer.is_resync(),
            pair_count: answer.pair_count(),
            served_by: answer.served_by().as_str(),
            engine: answer.engine().to_string(),
            skipped_pairs: answer.skipped().pairs(),
            tick: answer.tick(),
            late: answer.late().iter().cloned().map(Indices).collect(),
        }
    }

    /// The answer as Python has it.
    pub fn into_python(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        let class = imported!(py, "pairmask._answers", "SceneAnswer")?;
        class.call((), Some(&self.into_pyobject(py)?))
    }
}
