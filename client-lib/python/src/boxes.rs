//! Functions that make boxes, as new arrays that Python may write.

use pairmask::{Aabb, BoxSource, Placement, Sphere, Transformed};
use pairmask_core::write::par_write_boxes;
use pyo3::prelude::*;

use crate::arrays::{Numbers, Rows, check_len, numbers};
use crate::memory::Array;
use crate::process;

/// A new array of boxes.
fn new_boxes(boxes: impl IntoIterator<Item = Aabb>) -> Array {
    Array::writable::<f32, 6>(boxes.into_iter().map(bytemuck::cast).collect())
}

/// float32 boxes (n, 6) that contain boxes of float64, relative to an origin.
#[pyfunction]
#[pyo3(signature = (boxes, origin=[0.0; 3]))]
pub fn outward_from_f64(boxes: &Bound<'_, PyAny>, origin: [f64; 3]) -> PyResult<Array> {
    let wide = imported!(boxes.py(), "pairmask._convert", "doubles")?.call1((boxes, 6))?;
    let outward =
        |&[a, b, c, d, e, f]: &[f64; 6]| Aabb::outward_from_f64([a, b, c], [d, e, f], origin);
    Ok(new_boxes(numbers(&wide)?.as_chunks().0.iter().map(outward)))
}

/// float32 spheres (n, 4) that contain spheres of float64.
#[pyfunction]
pub fn spheres_from_f64(spheres: &Bound<'_, PyAny>) -> PyResult<Array> {
    let wide = imported!(spheres.py(), "pairmask._convert", "doubles")?.call1((spheres, 4))?;
    let outward = |&[x, y, z, radius]: &[f64; 4]| Sphere::outward_from_f64([x, y, z], radius);
    let rows = numbers(&wide)?.as_chunks().0.iter().map(outward).map(bytemuck::cast).collect();
    Ok(Array::writable::<f32, 4>(rows))
}

/// Boxes (n, 6) that hold one point each, of points (n, 3), for queries.
#[pyfunction]
pub fn points(at: Numbers<3>) -> Array {
    new_boxes(at.0.into_iter().map(Aabb::point))
}

/// What boxes (n, 6) may touch on their way from one place to another.
#[pyfunction]
pub fn swept(py: Python<'_>, before: Rows, after: Rows) -> PyResult<Array> {
    let (before, after) = (before.boxes(py)?, after.boxes(py)?);
    check_len(after.len(), before.len())?;
    Ok(new_boxes(before.iter().zip(&after).map(|(from, to)| Aabb::swept(from, to))))
}

/// What boxes (n, 6) may touch while they move by displacements (n, 3).
#[pyfunction]
pub fn swept_by(py: Python<'_>, boxes: Rows, displacements: Numbers<3>) -> PyResult<Array> {
    let boxes = boxes.boxes(py)?;
    check_len(displacements.0.len(), boxes.len())?;
    Ok(new_boxes(boxes.iter().zip(displacements.0).map(|(of, by)| of.swept_by(by))))
}

/// The boxes (n, 6) around local boxes (n, 6) that matrices transform: (n, 3, 4) or (n, 4, 4), a point p to
/// `m[:3, :3] @ p + m[:3, 3]`. They contain the corners, regardless of what is rounded.
#[pyfunction]
pub fn transformed(py: Python<'_>, locals: Rows, matrices: &Bound<'_, PyAny>) -> PyResult<Array> {
    let locals = locals.boxes(py)?;
    let columns = imported!(py, "pairmask._convert", "matrices")?.call1((matrices,))?;
    // The images of three axes and of the origin.
    let columns = numbers::<f32>(&columns)?;
    let matrices: Vec<[[f32; 3]; 4]> =
        columns.as_chunks::<12>().0.iter().map(|columns| bytemuck::cast(*columns)).collect();
    check_len(matrices.len(), locals.len())?;
    made(py, locals.len(), &Transformed::new(&locals, &matrices))
}

/// The boxes (n, 6) around local boxes (n, 6) that are scaled (n, 3), turned by quaternions `x y z w` (n, 4), and
/// moved (n, 3). They contain the corners, regardless of what is rounded.
#[pyfunction]
#[pyo3(signature = (locals, translation, rotation=None, scale=None))]
pub fn placed(
    py: Python<'_>,
    locals: Rows,
    translation: Numbers<3>,
    rotation: Option<Numbers<4>>,
    scale: Option<Numbers<3>>,
) -> PyResult<Array> {
    let locals = locals.boxes(py)?;
    let (n, identity) = (locals.len(), Placement::IDENTITY);
    let rotations = rotation.map_or_else(|| vec![identity.rotation; n], |given| given.0);
    let scales = scale.map_or_else(|| vec![identity.scale; n], |given| given.0);
    for rows in [translation.0.len(), rotations.len(), scales.len()] {
        check_len(rows, n)?;
    }
    let parts = translation.0.into_iter().zip(rotations).zip(scales);
    let placements: Vec<Placement> = parts
        .map(|((translation, rotation), scale)| Placement { translation, rotation, scale })
        .collect();
    made(py, n, &Transformed::new(&locals, &placements))
}

/// The boxes of a source, made on all cores while other Python threads run. A forked process has none of the
/// engines' threads.
fn made(py: Python<'_>, n: usize, source: &(impl BoxSource + Sync)) -> PyResult<Array> {
    process::check()?;
    let mut boxes = vec![Aabb::default(); n];
    py.detach(|| par_write_boxes(source, &mut boxes));
    Ok(new_boxes(boxes))
}
