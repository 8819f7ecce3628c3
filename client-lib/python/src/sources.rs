//! Boxes that are given: rows of six numbers, or what boxes are made of while they are written.

use pairmask::{Aabb, CenterHalf, MinMax, Placement, Transformed};
use pairmask_core::write::par_write_boxes;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::arrays::{Rows, check_len, new_boxes};
use crate::process;

type Points = Vec<[f32; 3]>;

/// What boxes are made of.
enum Source {
    MinMax {
        min: Points,
        max: Points,
    },
    CenterHalf {
        center: Points,
        half: Points,
    },
    /// By matrices: the images of three axes and of the origin.
    Transformed {
        locals: Vec<Aabb>,
        matrices: Vec<[[f32; 3]; 4]>,
    },
    Placed {
        locals: Vec<Aabb>,
        placements: Vec<Placement>,
    },
}

/// Boxes that are made while they are written, large numbers of them on all cores. Arrays are copied when it is
/// made.
#[pyclass(frozen, name = "BoxSource", module = "pairmask")]
pub struct PyBoxSource {
    source: Source,
}

/// Rows of so many numbers, `n` of them.
fn rows<const N: usize>(given: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<[f32; N]>> {
    let rows = Rows::of(given, N)?;
    rows.check_len(n)?;
    rows.numbers(given.py())
}

/// Two arrays of points, as many of each.
fn points(first: &Bound<'_, PyAny>, second: &Bound<'_, PyAny>) -> PyResult<(Points, Points)> {
    let first = Rows::of(first, 3)?.numbers(first.py())?;
    let second = rows(second, first.len())?;
    Ok((first, second))
}

#[pymethods]
impl PyBoxSource {
    /// Boxes by their corners.
    #[staticmethod]
    fn min_max(min: &Bound<'_, PyAny>, max: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (min, max) = points(min, max)?;
        Ok(Self { source: Source::MinMax { min, max } })
    }

    /// Boxes by their centres and half extents.
    #[staticmethod]
    fn center_half(center: &Bound<'_, PyAny>, half: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (center, half) = points(center, half)?;
        Ok(Self { source: Source::CenterHalf { center, half } })
    }

    /// The boxes around local boxes that matrices transform: (n, 3, 4) or (n, 4, 4), a point p to
    /// `m[:3, :3] @ p + m[:3, 3]`. They contain the corners, whatever is rounded.
    #[staticmethod]
    fn transformed(locals: &Bound<'_, PyAny>, matrices: &Bound<'_, PyAny>) -> PyResult<Self> {
        static MATRICES: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let py = locals.py();
        let locals = Rows::of(locals, 6)?.boxes(py)?;
        let by_rows = MATRICES.import(py, "pairmask._convert", "matrices")?.call1((matrices,))?;
        let by_rows: Vec<[f32; 12]> = rows(&by_rows, locals.len())?;
        let columns = |m: [f32; 12]| std::array::from_fn(|j| [m[j], m[4 + j], m[8 + j]]);
        let matrices = by_rows.into_iter().map(columns).collect();
        Ok(Self { source: Source::Transformed { locals, matrices } })
    }

    /// The boxes around local boxes that are scaled, turned by quaternions `x y z w`, and moved.
    #[staticmethod]
    #[pyo3(signature = (locals, translation, rotation=None, scale=None))]
    fn placed(
        locals: &Bound<'_, PyAny>,
        translation: &Bound<'_, PyAny>,
        rotation: Option<&Bound<'_, PyAny>>,
        scale: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let locals = Rows::of(locals, 6)?.boxes(locals.py())?;
        let n = locals.len();
        let identity = Placement::IDENTITY;
        let translations = rows::<3>(translation, n)?;
        let mut placements: Vec<Placement> = translations
            .into_iter()
            .map(|translation| Placement { translation, ..identity })
            .collect();
        if let Some(rotation) = rotation {
            for (placement, rotation) in placements.iter_mut().zip(rows(rotation, n)?) {
                placement.rotation = rotation;
            }
        }
        if let Some(scale) = scale {
            for (placement, scale) in placements.iter_mut().zip(rows(scale, n)?) {
                placement.scale = scale;
            }
        }
        Ok(Self { source: Source::Placed { locals, placements } })
    }

    /// The boxes as a new array.
    fn boxes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        new_boxes(py, &py.detach(|| self.to_vec())?)
    }

    fn __len__(&self) -> usize {
        match &self.source {
            Source::MinMax { min, .. } => min.len(),
            Source::CenterHalf { center, .. } => center.len(),
            Source::Transformed { locals, .. } | Source::Placed { locals, .. } => locals.len(),
        }
    }
}

impl PyBoxSource {
    /// Writes the boxes: `out` has room for as many. A forked process has no threads for that.
    fn write(&self, out: &mut [Aabb]) -> PyResult<()> {
        process::check()?;
        match &self.source {
            Source::MinMax { min, max } => par_write_boxes(&MinMax::points(min, max), out),
            Source::CenterHalf { center, half } => {
                par_write_boxes(&CenterHalf::points(center, half), out);
            }
            Source::Transformed { locals, matrices } => {
                par_write_boxes(&Transformed::new(locals, matrices), out);
            }
            Source::Placed { locals, placements } => {
                par_write_boxes(&Transformed::new(locals, placements), out);
            }
        }
        Ok(())
    }

    fn to_vec(&self) -> PyResult<Vec<Aabb>> {
        let mut boxes = vec![Aabb::default(); self.__len__()];
        self.write(&mut boxes)?;
        Ok(boxes)
    }
}

/// Boxes that are given.
pub enum Boxes<'py> {
    Rows(Rows),
    Source(Bound<'py, PyBoxSource>),
}

impl<'py> Boxes<'py> {
    /// An array of rows, or a source.
    pub fn of(given: &Bound<'py, PyAny>) -> PyResult<Self> {
        Self::read(given, |given| Rows::of(given, 6))
    }

    /// The same, where a single row may come without the brackets around it.
    pub fn of_some(given: &Bound<'py, PyAny>) -> PyResult<Self> {
        Self::read(given, |given| Rows::of_some(given, 6))
    }

    fn read(
        given: &Bound<'py, PyAny>,
        rows: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<Rows>,
    ) -> PyResult<Self> {
        match given.cast_exact::<PyBoxSource>() {
            Ok(source) => Ok(Self::Source(source.clone())),
            Err(_) => rows(given).map(Self::Rows),
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Rows(rows) => rows.len(),
            Self::Source(source) => source.get().__len__(),
        }
    }

    /// Writes them. There have to be as many as there is room for.
    pub fn write(&self, py: Python<'_>, out: &mut [Aabb]) -> PyResult<()> {
        match self {
            Self::Rows(rows) => rows.write_boxes(py, out),
            Self::Source(source) => {
                check_len(self.len(), out.len())?;
                source.get().write(out)
            }
        }
    }

    /// The boxes.
    pub fn to_vec(&self, py: Python<'_>) -> PyResult<Vec<Aabb>> {
        match self {
            Self::Rows(rows) => rows.boxes(py),
            Self::Source(source) => source.get().to_vec(),
        }
    }
}
