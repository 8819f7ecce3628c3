//! What a scene is asked: questions of Python's arrays, and answers as arrays.

use bytemuck::{Pod, cast_slice_mut};
use pairmask::cast::{Hits, Ray, Shapes};
use pairmask::filters::{FilterData, QueryFilterData};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;

use super::PyScene;
use crate::memory::Array;
use crate::rules::{Part, filter_data};

/// Filter data of `n` queries, where any part is given.
pub fn filter_data_of(
    py: Python<'_>,
    n: usize,
    parts: [Part<'_, '_>; 4],
) -> PyResult<Option<Vec<FilterData>>> {
    let is_given = parts.iter().any(Option::is_some);
    is_given.then(|| filter_data(py, Some(n), parts)).transpose()
}

pub fn filters(filter_data: Option<&[FilterData]>) -> QueryFilterData<'_> {
    filter_data.map_or(QueryFilterData::None, QueryFilterData::Each)
}

/// Rays or spheres of rows that were converted.
pub fn shapes<T: Pod>(py: Python<'_>, rows: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    let rows = PyBuffer::<f32>::get(rows)?;
    let mut shapes = vec![T::zeroed(); rows.shape()[0]];
    rows.copy_to_slice(py, cast_slice_mut(&mut shapes))?;
    Ok(shapes)
}

/// Rays of origins, directions, ends and half extents.
pub fn rays<'a, 'py>(
    py: Python<'py>,
    given: (&'a Bound<'py, PyAny>, &'a Bound<'py, PyAny>, Part<'a, 'py>, Part<'a, 'py>),
) -> PyResult<Vec<Ray>> {
    shapes(py, &imported!(py, "pairmask._convert", "rays")?.call1(given)?)
}

pub fn hits_of(closest: Option<u32>) -> Hits {
    closest.map_or(Hits::All, Hits::Closest)
}

impl PyScene {
    /// Rows (query, index) of hits, and their distances.
    pub(super) fn cast_shapes<'py>(
        &self,
        py: Python<'py>,
        shapes: Shapes<'_>,
        hits: Hits,
        parts: [Part<'_, '_>; 4],
    ) -> PyResult<Bound<'py, PyAny>> {
        let filter_data = filter_data_of(py, shapes.len(), parts)?;
        let found = self.with_detached(py, |scene| {
            scene.cast_filtered(shapes, hits, filters(filter_data.as_deref()))
        })?;
        let pairs = found.hits().iter().map(|hit| [hit.query, hit.index]).collect();
        let distances = found.hits().iter().map(|hit| [hit.distance]).collect();
        let of = (Array::read_only(pairs), Array::read_only(distances));
        imported!(py, "pairmask._answers", "Hits")?.call1(of)
    }
}
